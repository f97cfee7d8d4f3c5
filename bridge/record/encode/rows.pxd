cdef class Rows:
    cdef object _columns, _template, _places, _ops, _scales, _log_column
    cdef public object ints, floats, size
    cdef public list channels

    cpdef object take(self, object chunk)
