cdef class MotorDrivers:
    cdef public bint enabled
    cdef long long _rest_ticks

    cpdef object switch(self, object state, object duties, object wheels)
