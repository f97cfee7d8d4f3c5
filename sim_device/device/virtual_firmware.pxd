from sim_device.device.control cimport Control
from sim_device.device.freshness cimport Freshness
from sim_device.device.sampling cimport Sampler


cdef class Firmware:
    cdef public object identity, session_id, link, parameters, schedule, reboot_wanted, keyring
    cdef public object telemetry
    cdef public bint negotiated
    cdef bint _status_wanted
    cdef object _flash, _lines, _off_bus, _imu_info, _clock, _commands, _unknown_hello_us, _imu_sent
    cdef object _saving, _declared
    cdef public Control control
    cdef Sampler _sampler
    cdef Freshness _freshness
    cdef long long _received_us, _power_phase, _range_phase
    cdef dict _handlers

    cpdef object receive(self, object data, long long now_us)
    cpdef object data_to_send(self)
    cpdef object _reject(self, object message, object frame, long long now_us)
    cpdef object _send(self, object message, long long now_us, object rank=*)
    cpdef object _handle(self, object message, object frame, long long now_us)
    cpdef double _extra_delay_us(self, object frame, long long now_us)
    cpdef object _time(self, object request, double _extra_us, long long now_us)
    cpdef object _describe(self, object question, double _extra_us, long long now_us)
    cpdef object _describe_enum(self, object question, double _extra_us, long long now_us)
    cpdef object _answer_unknown_session(self, long long now_us)
    cpdef bint _open(self, object hello, long long now_us)
    cpdef object _hello(self, long long now_us)
    cpdef object _close(self)
    cpdef object _forget_host(self)
    cpdef object stop(self, object cause, object event=*)
    cpdef object stream_spec(self, object type_id)
    cpdef object begin_save(self)
    cpdef object _carry_on_saving(self, long long now_us)
    cpdef object _setpoint(self, object message, double extra_us, long long now_us)
    cpdef object _duty(self, object message, double extra_us, long long now_us)
    cpdef object log(self, object level, object line)
    cpdef object tick(self, long long now_us)
    cpdef object _answer_stop(self, object due, long long now_us)
    cpdef object _send_line(self, long long now_us)
    cpdef object _send_streams(self, object due, long long now_us)
