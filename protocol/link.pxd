cimport cython

from protocol.schema.codec cimport Codec
from protocol.send_queue cimport SendQueue


cdef class LinkBase:
    cdef public Codec codec
    cdef public object statistics
    cdef public set disabled
    cdef public object key
    cdef public object _sends
    cdef public set _own_types
    cdef public SendQueue _queue
