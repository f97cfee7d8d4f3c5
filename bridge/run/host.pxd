from bridge.run.recording cimport HostRecords
from bridge.session.ingest cimport Ingest
from bridge.session.link_stats cimport WireStatistics
from bridge.session.session cimport Session


cdef class Host:
    cdef dict __dict__
    cdef public object model, commands, swept, hello, drive_pose, supervision, on_drive_pose, sink
    cdef public object plausibility
    cdef public object localisation
    cdef public object mission
    cdef public Session session
    cdef public Ingest ingest
    cdef public double path_m
    cdef public WireStatistics wire
    cdef object _pings, _tap, _counts, _jumps, _imu
    cdef HostRecords _records
    cdef long long _control_ns, _map_ns, _clock_ns, _silent_ns, _counted_ns
    cdef bint _slow, _partial
    cdef list _missing
    cdef dict _listeners

    cpdef object open(self, long long now_ns)
    cpdef object receive(self, object data, long long now_ns)
    cpdef object poll(self, long long now_ns)
    cpdef object data_to_send(self, long long now_ns)
    cpdef object sent(self, object data, long long now_ns)
    cpdef object discard_output(self)
    cpdef object next_deadline(self)
    cpdef object snapshot(self, object now_ns=*)
    cpdef object supervise(self, object supervisor)
    cpdef bint resume_run(self, long long now_ns)
    cpdef object end(self, object ending, long long now_ns)
    cpdef object _digest(self, object events, long long now_ns)
    cpdef object _happened(self, object event, long long now_ns)
    cpdef object _serve(self, long long now_ns)
    cpdef object _request(self, object request, long long now_ns)
    cpdef object _answered(self, object outcome, long long now_ns)
    cpdef object _changed(self, object event, long long now_ns)
    cpdef object _session_ready(self, object event, long long now_ns)
    cpdef object _check_needs(self, long long now_ns)
    cpdef object _range(self, object message, long long device_us, long long now_ns)
    cpdef object _log_text(self, object message, long long device_us, long long now_ns)
    cpdef object _status(self, object status, long long device_us, long long now_ns)
    cpdef object _control(self, long long now_ns)
    cpdef object _supervised(self, object supervision, object command, long long now_ns)
    cpdef object _obey_supervision(self, long long now_ns)
    cpdef object _stale(self, long long now_ns)
    cpdef object _judge_link(self, long long now_ns)
    cpdef object _driven(self, object pose, long long now_ns)
    cpdef bint _is_silent(self, long long now_ns)
    cpdef object use_unix_offset(self, long long unix_offset_ns)
    cpdef object record_map(self, long long now_ns)
