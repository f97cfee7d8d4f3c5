from sim_device.device.signs cimport Signs


cdef class Health:
    cdef public object bits
    cdef public bint battery_empty
    cdef object _empty, _imu, _longest, _disagrees, _implausible
    cdef object _unseen_contacts, _sonar_m
    cdef list _up, _pressed, _side_rad
    cdef object _currents_a, _counts, _range_counts
    cdef long long _tick, _repeats, _moved_tick, _jolt_tick, _up_sum, _gravity_sum, _gravity_next
    cdef Signs _signs
    cdef bint _has_ultrasonic, _touched
    cdef double _unseen_m
    cdef list _side_m

    cpdef object tick(self, object imu, object counts, object wheels, object duties)
    cpdef object _check_jolt(self, long long up_lsb, long long tick)
    cpdef object _counted(self, object counts)
    cpdef object _judge_imu(self, object imu, object wheels)
    cpdef object _judge_stall(self, object wheels)
    cpdef object on_power(self, object reading, double low_v, double empty_v)
    cpdef object on_around(self, object around, double wheel_base_m, double metres_per_count)
    cpdef bint _switch_stays(self, object around)
    cpdef bint _is_ultrasonic_wrong(self, object sonar_m, object touched, double ahead_m, double turned_rad)
