from bridge.record.chunk cimport OpenChunk
from bridge.record.encode.rows cimport Rows


cdef class ChunkedFile:
    cdef public object out
    cdef public OpenChunk chunk
    cdef dict _schema_ids
    cdef object _tap
    cdef list _declarations
    cdef public bint closed

    cpdef object add_attachment(
        self,
        object name,
        object media_type,
        object data,
        long long time_ns,
    )
    cpdef object add_metadata(self, object name, object data)
    cpdef object add_channel(self, object topic, object message_encoding, object schema)
    cpdef object add_message(
        self,
        object channel_id,
        long long log_ns,
        long long publish_ns,
        object sequence,
        object data,
    )
    cpdef Rows rows(self, object ints, object floats, object messages)
    cpdef object begin_row(self, long long log_ns, object size)
    cpdef object next_chunk(self, long long log_ns)
    cpdef object flush(self)
    cpdef object finish(self)
