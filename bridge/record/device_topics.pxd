from bridge.record.chunk cimport OpenChunk
from bridge.record.chunked_file cimport ChunkedFile


cdef class DeviceTopics:
    cdef ChunkedFile _file
    cdef OpenChunk _chunk
    cdef object _spec, _encoder, _layout, _channel, _ros, _ros_channel, _raw, _fixed
    cdef object _sentinels, _whole
    cdef dict _forms

    cpdef object rescale(self, object spec)
    cpdef object write(self, object record)
