cimport cython

from protocol cimport primitives
from protocol.link cimport LinkBase
from protocol.uart.framing cimport UartEncoder, UartParser


cdef int _PLAIN_MASK, _OWN_VERSION
cdef object _DamagedFrame, _Received


cdef class _Ordinary:
    cdef object spec, unpack
    cdef type cls
    cdef Py_ssize_t size


cdef class Link(LinkBase):
    cdef UartParser _parser
    cdef UartEncoder _encoder
    cdef int _seq, _sender_mask
    cdef list _expected_seq, _ordinary
    cdef dict _boots

    @cython.locals(
        parser=UartParser,
        by_type=dict,
        expected=list,
        found=list,
        frames="long long",
        damaged="long long",
        rare="long long",
        type_id=int,
        sender=int,
        ordinary=_Ordinary,
    )
    cpdef list receive(self, bytes data, object now_us=*)

    cdef object _interpret(self, object frame)

    @cython.locals(
        data=bytes,
        node=int,
        type_id=int,
        t_us=object,
        payload=bytes,
        content=bytes,
        flags=int,
        version_flags=int,
    )
    cpdef bytes data_to_send(self)
