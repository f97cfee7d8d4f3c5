cdef class DeviceClock:
    cdef double _drift_ppm, _rate, _own_us
    cdef long long _true_us, _seen_us
    cdef public long long offset_us

    cpdef object jump_us(self, object delta)
    cpdef object boot(self, long long true_us)
    cpdef long long uptime_us(self, long long true_us)
    cpdef long long stamp_us(self, long long true_us)
    cpdef long long true_us(self, long long uptime_us)
