cimport cython

from protocol cimport primitives


cdef unsigned int[256] _CRC_TABLE
cdef Py_ssize_t _MAX_ENCODED, _MAX_PAYLOAD, _MIN_DECODED
cdef unsigned int _RESIDUE
cdef object _Frame, _DamagedFrame, _COBS, _LENGTH, _CRC


cdef class UartEncoder:
    cdef bytearray _body, _encoded

    @cython.locals(
        body="unsigned char *",
        encoded="unsigned char *",
        content="const unsigned char *",
        size=Py_ssize_t,
        place=Py_ssize_t,
        zero=Py_ssize_t,
        crc="unsigned int",
        byte="unsigned char",
    )
    cpdef bytes frame(
        self,
        unsigned char version_flags,
        unsigned char node,
        unsigned char type_id,
        unsigned char seq,
        unsigned int t_us,
        bytes payload,
    )


cdef class UartParser:
    cdef readonly long long bytes_seen, frames, damaged
    cdef readonly unsigned char version_flags, node, type_id, seq
    cdef readonly bytes payload
    cdef bytes _data
    cdef Py_ssize_t _place, _length
    cdef bytearray _stretch, _body

    @cython.locals(event=object)
    cpdef list feed(self, bytes data)

    cpdef void take(self, bytes data)

    @cython.locals(
        view="const unsigned char *",
        stretch="unsigned char *",
        begin=Py_ssize_t,
        length=Py_ssize_t,
        place=Py_ssize_t,
        byte="unsigned char",
    )
    cpdef object next_event(self)

    @cython.locals(
        body="unsigned char *",
        stretch="unsigned char *",
        left="unsigned char",
        crc="unsigned int",
        byte="unsigned char",
        place=Py_ssize_t,
    )
    cdef object _judged(self, Py_ssize_t length)

    @cython.locals(body="unsigned char *", t_us="unsigned int")
    cdef object _frame(self, Py_ssize_t end)
