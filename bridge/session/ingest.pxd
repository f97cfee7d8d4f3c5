from bridge.session.timesync cimport TimeSync


cdef class Ingest:
    cdef public TimeSync sync
    cdef public object device_us
    cdef public long long unix_offset_ns
    cdef object _mapped
    cdef long long _stamp, _arrived_ns

    cpdef object take(self, object received, long long now_ns)
    cpdef bint exchange(self, object ping)
    cpdef object reset(self)
