cdef class Ekf:
    cdef public object drift, joint_covariance, yaw_noise, path_noise
    cdef public double x_m, y_m, theta_rad, heading_mark_rad
    cdef public list walls
    cdef public object slip_monitor
    cdef public double gyro_bias_rad_s, motion_bias_rad_s, gyro_scale, wheel_scale_error
    cdef double _bias_slope, _shaken, _worst_shaken, _worst_slip
    cdef object _tuning, _odometry, _due, _transition, _noise

    cpdef object update(
        self,
        object index,
        object rows,
        object innovation,
        object noise,
        object held=*,
    )
    cpdef object inflate(self, double sigma_m, double sigma_rad)
    cpdef object inflate_slip(self, double along_m, double across_m)
    cpdef object apply(self, object step)
    cpdef object restart(self, object pose)
    cpdef object wait(self, double time_s)
    cpdef object propagate_covariance(self)
    cpdef object _inflate_for_wheels(self)
    cpdef object warm(self, double change_c)
    cpdef object shift(self, double ahead_m, double aside_m)
    cpdef object inflate_for_vibration(self, double vibration_m_s2)
