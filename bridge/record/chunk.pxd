from bridge.record.encode.rows cimport Rows


cdef class OpenChunk:
    cdef object _zstd
    cdef list _parts, _entries, _rows
    cdef public long long size
    cdef public long long earliest_ns, deadline_ns

    cpdef object declare(self, object record)
    cpdef object add_channel(self, object record)
    cpdef Rows rows(self, object ints, object floats, object messages)
    cpdef object begin(self, long long log_ns)
    cpdef object add(
        self,
        object channel_id,
        long long log_ns,
        long long publish_ns,
        object sequence,
        object data,
    )
