from bridge.motion.estimation.disturbance cimport BumpDetector, InertialBridge, SlipDetector
from bridge.motion.estimation.ekf cimport Ekf
from bridge.motion.estimation.standstill cimport Standstill


cdef class PoseEstimator:
    cdef public Ekf ekf
    cdef public object tuning
    cdef object _model, _counts, _imu_s, _chip_c
    cdef double _left_m, _right_m
    cdef object _slipping
    cdef Standstill _standstill
    cdef double _encoder_s, _encoder_gap_s, _speed, _yaw_rate, _turning_s
    cdef bint _known, _gyro_gap
    cdef BumpDetector _bumps
    cdef SlipDetector _slips
    cdef InertialBridge _bridge
    cdef list _disturbances

    cpdef object pose_at(self, double t_s)
    cpdef object reset(self, object pose)
    cpdef object release(self)
    cpdef object hold(self)
    cpdef object on_imu(
        self,
        double t_s,
        double gyro_z_rad_s,
        object accel_x_m_s2=*,
        object accel_y_m_s2=*,
        object temperature_c=*,
    )
    cpdef object on_encoders(self, double t_s, object left, object right)
    cpdef object _warm_to(self, double temperature_c)
    cpdef object _roll(self, double t_s, double dt, double left, double right)
    cpdef object _rotation(self, double t_s, double dt_s, double wheel_turn)
    cpdef object _feel(self, double t_s, double dt, double ahead, double aside)
    cpdef object _end_bridge(self, InertialBridge bridge)
    cpdef double _path_without_slip(self, double t_s, double dt, double left, double right, double rotation)
    cpdef object _note(self, object kind, double t_s, double size)
    cpdef object _update_bias(self, double mean_rad_s)
