cdef class BumpDetector:
    cdef double _offset_x, _offset_y, _last_x, _last_y
    cdef int _rests, _ringing
    cdef double _variance, _lasting
    cdef list _held
    cdef object _tuning

    cpdef object rest(self, double accel_x, double accel_y)
    cpdef object leave_rest(self)
    cpdef object level(self, double accel_x, double accel_y)
    cpdef bint moving(self, double ahead, double aside)


cdef class SlipDetector:
    cdef double _lasting_s
    cdef int _side
    cdef object _tuning

    cpdef object update(self, double left_m, double right_m, double turn_m, double dt_s)


cdef class InertialBridge:
    cdef public double vx_m_s, vy_m_s, age_s, restored_m, unconfirmed_m
    cdef public bint clipped, stalled
    cdef double _agreed_s, _away_s, _away_m, _wheels_m_s, _gain_m_s, _withheld_m
    cdef double _into
    cdef object _tuning

    cpdef object push(self, double ahead, double aside, double yaw_rate, double dt_s)
    cpdef bint has_ended(self, double v_m_s, double dt_s)
