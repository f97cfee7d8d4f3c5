cimport cython


cdef class SendQueue:
    cdef public list frames

    cpdef object add(self, tuple frame)
    @cython.locals(kept=list, replaced="Py_ssize_t")
    cpdef Py_ssize_t supersede(self, object node, object type_id)
    cpdef list take(self)
