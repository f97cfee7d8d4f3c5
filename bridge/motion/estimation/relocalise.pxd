cdef class Relocaliser:
    cdef object _estimator, _contact_tuning, _tuning
    cdef double _radius_m, _since_graze_m, _pulse_s
    cdef object _ultrasonic, _grazing_range_m, _near, _sides, _front, _echo_m
    cdef object _contact
    cdef public object walls
    cdef public object yaw_fixes, position_fixes

    cpdef object _place(self, double t_s)


cdef class _Nearness:
    cdef object _last

    cpdef double take(self, object range_m)
