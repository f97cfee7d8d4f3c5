cdef class ImuSensor:
    cdef object _plant
    cdef object _noise, _rng, _faults, _lift, _alias, _period_eighths, _bias, _extra, _chip
    cdef object _own_bias, _normals, _at, _was_ms, _sample_no, _last, _reported
    cdef object _reported_bias
    cdef long long _interval_ms
    cdef public long long samples

    cpdef object read(self)
    cpdef object _sample(self, object now)
    cpdef object _obey(self, long long tick_ms)
    cpdef object _feel_lift(self, long long tick_ms)
    cpdef object _obey_bias(self)
    cpdef object _set_interval(self, long long interval_ms)
