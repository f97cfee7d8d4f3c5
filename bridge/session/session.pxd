cdef class Session:
    cdef dict __dict__
    cdef public object link, state, hello, session_id, round_trip
    cdef object _key, _new_session_id, _name, _negotiation, _handshakes, _answers, _tries
    cdef object _boot_known, _schema_known, _catalogue, _open_stop, _pings, _wanted_node, _evidence

    cdef bint _joined, _greeted, _renew, _restless
    cdef long long _last_frame_ns, _opened_ns, _next_ns
    cdef list _events
    cdef object _outbox
    cdef dict _handlers

    cpdef object open(self, long long now_ns)
    cpdef object close(self)
    cpdef object unplugged(self, long long now_ns)
    cpdef object replugged(self, long long now_ns)
    cpdef object receive(self, object data, long long now_ns)
    cpdef object poll(self, long long now_ns)
    cpdef object _notice(self, long long now_ns)
    cpdef object data_to_send(self)
    cpdef object next_deadline(self)
    cpdef object setpoint(
        self,
        double v_m_s,
        double yaw_rate_rad_s,
        long long ttl_ms,
        long long now_ns,
    )
    cpdef object duty(self, double left, double right, long long ttl_ms, long long now_ns)
    cpdef object stop(self, object cause, long long now_ns)
    cpdef object clear_stop(self, object cause, long long now_ns)
    cpdef object set_mode(self, object mode, long long now_ns)
    cpdef object set_key(self, object key, long long now_ns)
    cpdef object _drain(self)
    cpdef object _periodic(self, long long now_ns)
    cpdef object _handle(self, object event, long long now_ns)
    cpdef object _reply(self, object reply, object event, long long now_ns)
    cpdef object _time_reply(self, object reply, object event, long long now_ns)
    cpdef object _lose(self, long long now_ns, object what=*, object why=*)
    cpdef object _no_device(self)
    cpdef object _ask(self, long long now_ns)
    cpdef object _hello(self, object hello, object event, long long now_ns)
    cpdef object _challenge(self, object message, object event, long long now_ns)
    cpdef object _choose(self, long long now_ns)
    cpdef object _accept(self, object hello, object node, long long now_ns)
    cpdef object _negotiate(self, object hello, long long now_ns)
    cpdef object _greet(self, long long now_ns)
    cpdef object _answer(self, object reply, object event, long long now_ns)
    cpdef object _ready(self, long long now_ns)
    cpdef object fire(self, object what, object why)
    cpdef object _fail(self, object what, object kind, object text)
