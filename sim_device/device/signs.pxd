cdef class _Side:
    cdef public int against, agrees, own, crossed
    cdef public bint was_ahead

    cpdef object tick(self, double duty, double speed_m_s, double other_duty, double other_m_s)


cdef class Signs:
    cdef public object bits
    cdef public bint driven
    cdef _Side _left, _right

    cpdef object tick(self, object duties, object speeds_m_s)
    cpdef object _clear_agreeing(self)
