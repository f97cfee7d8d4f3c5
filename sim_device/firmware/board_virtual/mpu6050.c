#include "mpu6050.h"

#include <string.h>

#define ASLEEP 0x40u
#define DATA_READY 1u

void mpu6050_power_on(mpu6050_t *imu)
{
    memset(imu->registers, 0, sizeof imu->registers);
    imu->registers[MPU6050_POWER] = ASLEEP;
    imu->registers[MPU6050_WHO_AM_I] = 0x68u;
}

void mpu6050_write(mpu6050_t *imu, uint8_t number, uint8_t value)
{
    const bool data = number >= MPU6050_INT_STATUS && number < MPU6050_DATA + MPU6050_DATA_BYTES;
    if (number < MPU6050_WHO_AM_I && !data) {
        imu->registers[number] = value;
    }
}

void mpu6050_read(mpu6050_t *imu, uint8_t number, uint8_t *out, unsigned length)
{
    for (unsigned i = 0; i < length; i++) {
        const unsigned from = number + i;
        out[i] = from < MPU6050_REGISTERS ? imu->registers[from] : 0u;
        if (from == MPU6050_INT_STATUS) {
            imu->registers[from] = 0;
        }
    }
}

void mpu6050_convert(mpu6050_t *imu, const int16_t counts[7])
{
    if ((imu->registers[MPU6050_POWER] & ASLEEP) != 0) {
        return;
    }
    for (unsigned i = 0; i < 7u; i++) {
        const uint16_t value = (uint16_t)counts[i];
        imu->registers[MPU6050_DATA + 2u * i] = (uint8_t)(value >> 8);
        imu->registers[MPU6050_DATA + 2u * i + 1u] = (uint8_t)value;
    }
    imu->registers[MPU6050_INT_STATUS] |= DATA_READY;
}
