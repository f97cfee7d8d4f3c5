from bridge.session.timesync cimport TimeSync


cdef class Spread:
    cdef public long long count
    cdef public long long min_ns, max_ns
    cdef list _bins

    cpdef object add(self, double value_ns)
    cpdef long long percentile_ns(self, double percent)
    cpdef object to_dict(self)


cdef class MessageStatistics:
    cdef public object name
    cdef public long long count, lost, reordered
    cdef object _stream
    cdef int _alike, _age_count
    cdef long long _last_us, _spent_us
    cdef double _period_us, _candidate_us, _age_sum_ns, _age_most_ns

    cpdef object take(self, long long t_us, long long arrived_ns, object fit)
    cpdef object _gap(self, long long gap_us)
    cpdef object to_dict(self)


cdef class WireStatistics:
    cdef public Spread round_trip
    cdef list _aside
    cdef dict _kinds
    cdef public object queue

    cpdef object count(self, TimeSync sync)
    cpdef object to_dict(self)
