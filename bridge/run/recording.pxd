from bridge.session.link_stats cimport WireStatistics
from bridge.session.timesync cimport TimeSync


cdef class Tally:
    cdef public object counts, length
    cdef public dict first
    cdef public long long due_ns


cdef class HostRecords:
    cdef object _write, _planner, _planner_state, _faults, _stop_cause, _disturbance, _keys
    cdef public long long unix_offset_ns
    cdef bint _bus, _other_host
    cdef long long _link_ns
    cdef Tally _damaged, _rejected
    cdef public object counts

    cpdef object named(
        self,
        long long now_ns,
        object severity,
        object source,
        object kind,
        object text,
        object data,
    )
    cpdef object rejected(self, object event, long long now_ns)
    cpdef object _report_damaged(self, long long now_ns)
    cpdef object _report_rejected(self, long long now_ns)
    cpdef object log_text(self, object message, long long now_ns)
    cpdef object status(self, object status, long long now_ns)
    cpdef object link(self, WireStatistics wire, long long now_ns)
    cpdef object again(self, object event, long long now_ns)
    cpdef object asking(self, long long now_ns)
    cpdef object identity(self, object event, long long now_ns)
    cpdef object command(self, object command, object target, long long now_ns)
    cpdef object pose(self, object pose, object estimator, long long now_ns)
    cpdef object plan(self, object runner, long long now_ns)
    cpdef object swept(self, object swept, long long now_ns)
    cpdef object clock(self, TimeSync sync, object hello, long long now_ns)
