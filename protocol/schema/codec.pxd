cimport cython

from protocol cimport primitives


cdef class Codec:
    cdef public object catalogue
    cdef public object extra_bytes
    cdef dict _shared, _whole

    cpdef object shared_fields(self, object spec)

    @cython.locals(layout=object)
    cpdef object decode(self, object spec, bytes payload)

    @cython.locals(layout=object, values=tuple, tail=bytes)
    cdef object _decode_other(self, object spec, bytes payload)

    @cython.locals(known=tuple)
    cpdef tuple encode(self, object message)

    cdef bytes _encode_other(self, object spec, tuple values, object shared)
