from bridge.record.chunked_file cimport ChunkedFile
from bridge.record.device_topics cimport DeviceTopics


cdef class RunWriter:
    cdef public object path
    cdef ChunkedFile _file
    cdef object _ros, _imu_scale, _last_ns
    cdef dict _ros_channels, _device, _rows, _flat_channels, _foxglove_channels, _handlers
    cdef DeviceTopics _imu_info

    cpdef object write(self, object record)
    cpdef object flush(self)
    cpdef object close(self, object summary=*)
    cpdef object _raw(self, object record)
    cpdef object _raw_can(self, object record)
    cpdef object _device_message(self, object record)
    cpdef DeviceTopics _topics(self, object cls)
    cpdef object _note_imu(self, object info)
    cpdef object _pose(self, object record)
    cpdef object _truth(self, object record)
    cpdef object _command(self, object record)
    cpdef object _planner(self, object record)
    cpdef object _event(self, object record)
    cpdef object _log(self, object record)
    cpdef object _clock(self, object record)
    cpdef object _coverage(self, object record)
    cpdef object _room(self, object record)
    cpdef object _identity(self, object record)
    cpdef object _add_flat(self, object topic, object layout, long long log_ns, object data)
    cpdef object _add_foxglove(self, object topic, object message, long long log_ns, object data)
    cpdef object _foxglove_channel(self, object topic, object message)
    cpdef object _ros_topic(self, object topic)
    cpdef object _add_grid(self, object topic, object record)
    cpdef object _flat_channel(self, object topic, object layout)
    cpdef object _ros_channel(self, object topic, object type_name)
