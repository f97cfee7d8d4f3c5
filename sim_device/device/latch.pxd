cdef class StopLatch:
    cdef public object cause

    cpdef bint latch(self, object cause)
    cpdef bint clear(self, object cause)
