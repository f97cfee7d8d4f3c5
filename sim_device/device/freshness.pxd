cdef class Freshness:
    cdef object _host_us
    cdef double _min_us
    cdef long long _at_us

    cpdef object reset(self)
    cpdef double extra_delay_us(self, object host_stamp, long long arrival_us)
