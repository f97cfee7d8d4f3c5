cdef class SampleTimes:
    cdef public dict taken_s
    cdef public object jumps
    cdef dict _newest_us, _rejected
    cdef double _quickest_s, _usual_s
    cdef double _at_s

    cpdef object forget(self)
    cpdef object observe(self, long long device_us, double now_s)
    cpdef object _follow(self, double delay_s, double now_s)
    cpdef bint take(self, object stream, long long device_us, double now_s)
    cpdef bint _clock_reset(self, object stream, long long device_us, double now_s)
