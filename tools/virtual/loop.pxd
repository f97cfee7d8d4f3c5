from bridge.run.host cimport Host


cdef class VirtualLoop:
    cdef public long long now_us
    cdef public object end_error_m, max_error_m
    cdef object _body
    cdef object _device, _on_tick, _on_step, _to_device, _to_host
    cdef long long _latency_us, _tick_ms, _host_us, _device_us
    cdef dict _poses
    cdef public Host host

    cpdef object connect(self, Host host)
    cpdef object wake(self)
    cpdef object forget_errors(self)
    cpdef object step(self, object end_us=*)
    cpdef object _step_device(self, long long now_us)
    cpdef bint _deliver(self, long long now_us)
    cpdef object _step_host(self, long long now_us)
    cpdef object _remember(self)
    cpdef object _receive(self, object data, long long now_ns)
