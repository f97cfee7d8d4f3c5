cdef class Watchdog:
    cdef public double first, second
    cdef public object counter
    cdef public long long until_us
    cdef bint _was_live

    cpdef object reset(self)
    cpdef object halt(self)
    cpdef bint take(
        self,
        double first,
        double second,
        long long time_to_live_ms,
        object counter,
        double extra_delay_us,
        long long now_us,
    )
    cpdef long long left_us(self, long long now_us)
    cpdef bint expired(self, long long now_us)


cdef class SetpointWatchdog(Watchdog):
    cpdef bint offer(self, object setpoint, double extra_delay_us, long long now_us)


cdef class DutyWatchdog(Watchdog):
    cpdef bint offer(self, object wanted, double extra_delay_us, long long now_us)
