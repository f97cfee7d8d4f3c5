/* Interface between the source files for boards with an STM32F429. board_config.h defines the pins
 * of one board. The following pins are equal on all boards:
 *
 *   PE9  PE11      TIM1 CH1, CH2 (AF1): L298N IN1, IN2, the left motor
 *   PE13 PE14      TIM1 CH3, CH4 (AF1): L298N IN3, IN4, the right motor
 *   PE8  PE10      L298N ENA, ENB
 *   PB5            the IMU's INT
 *   PA4            HC-SR04 trigger
 *   PA0            TIM5 CH1 (AF2): HC-SR04 echo, divided to 3.3 V
 *   PF0 PF1 PF2    cliff sensors, high if the floor is missing or a wire is broken
 *   PF3 PF4        bumper switches left, right, connected to ground if pressed
 *
 * Interrupt priorities: 2 link, 4 IMU, 5 echo, 6 flash, 8 SysTick (1 ms). */
#ifndef F429_H
#define F429_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"
#include "stm32f4.h"

#include "board_config.h"

#ifndef BOARD_NODE
#define BOARD_NODE 1u
#endif
#ifndef BOARD_BAUD
#define BOARD_BAUD 921600u
#endif

#define CORE_HZ 168000000u
#define APB1_HZ (CORE_HZ / 4u)
#define APB2_HZ (CORE_HZ / 2u)
#define TIMER_APB1_HZ (2u * APB1_HZ) /* RM0090 6.2: twice the bus clock if the bus clock is divided
                                        */
#define TIMER_APB2_HZ (2u * APB2_HZ)

enum { PORT_A, PORT_B, PORT_C, PORT_D, PORT_E, PORT_F, PORT_G };
enum { LEVEL_LINK = 2, LEVEL_IMU = 4, LEVEL_ECHO = 5, LEVEL_FLASH = 6, LEVEL_TICK = 8 };

/* The device that receives the data from interrupts. */
extern firmware_t *device;

#if defined(__arm__)
static inline uint32_t uptime_us(void) { return TIM2->cnt; }
#else
uint32_t uptime_us(void); /* tests define their own function */
#endif

typedef enum { PULL_NONE, PULL_UP, PULL_DOWN } pull_t;
void pin_input(unsigned port, unsigned pin, pull_t pull);
void pin_output(unsigned port, unsigned pin);
void pin_alternate(unsigned port, unsigned pin, unsigned function, pull_t pull, bool open_drain);
void pin_analog(unsigned port, unsigned pin);
void pin_write(unsigned port, unsigned pin, bool high);
bool pin_read(unsigned port, unsigned pin);
/* Change a pin from its alternate function to direct control as an open-drain output. */
void pin_open_drain(unsigned port, unsigned pin);

/* Return false without a crystal or ST-LINK clock, or if the PLL does not lock or has no voltage for
 * 168 MHz; the chip then runs from its internal oscillator. */
bool clocks_start(void);
uint8_t reset_cause(void);
uint32_t boot_id(const uint8_t uid[12]);

void uart_start(void);
void uart_clear_overrun(void); /* called by the tick's interrupt */
bool uart_drained(void);
void can_start(uint8_t node);
bool can_drained(void);
void motors_start(void);
void encoders_start(void);
void imu_start(void);
void imu_millisecond(void); /* called by the tick's interrupt */
void sonar_start(void);
void sonar_millisecond(void); /* called by the tick's interrupt */
uint16_t sonar_mm(void);
void analog_start(void);
void analog_millisecond(void); /* called by the tick's interrupt */
bool flash_can_save(void);

enum {
    ANALOG_INFRARED_LEFT,
    ANALOG_INFRARED_RIGHT,
    ANALOG_BATTERY,
    ANALOG_LOGIC,
    ANALOG_MOTOR_LEFT,
    ANALOG_MOTOR_RIGHT,
    ANALOG_COUNT
};
/* Return the mean of the last ANALOG_SETS conversions of a channel, mV at the pin. */
uint32_t analog_mv(unsigned channel);
uint32_t analog_sampled_us(void);
#define ANALOG_AGE_US 1500u /* age of the mean: half of its time interval */

#endif
