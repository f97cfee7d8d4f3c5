/* Drivers of the motors (L298N on TIM1) and the encoders (TIM3 and TIM4). RM0090 sections 17 and
 * 18. */
#include <stddef.h>

#include "f429.h"
#include "stm32f4.h"

#define PWM_HZ 20000u /* not audible; the L298's data sheet allows 40 kHz */
#define PWM_TOP (TIMER_APB2_HZ / PWM_HZ)

/* Start the PWM. One end of a motor is switched, the other end stays low. Between the pulses both
 * ends are low, which connects the ends (slow decay). So the mean voltage is proportional to the
 * duty. */
void motors_start(void) {
    TIM1->psc = 0;
    TIM1->arr = PWM_TOP - 1u;
    const uint32_t both = 6u << 4 | 1u << 3 | 6u << 12 | 1u << 11; /* PWM mode 1, preloaded */
    TIM1->ccmr[0] = both;
    TIM1->ccmr[1] = both;
    for (unsigned i = 0; i < 4u; i++) {
        TIM1->ccr[i] = 0;
    }
    TIM1->ccer = TIM_CCER_CCE(1) | TIM_CCER_CCE(2) | TIM_CCER_CCE(3) | TIM_CCER_CCE(4);
    TIM1->egr = TIM_EGR_UG;
    TIM1->bdtr = TIM_BDTR_MOE | TIM_BDTR_OSSR | TIM_BDTR_OSSI;
    TIM1->cr1 = TIM_CR1_ARPE | TIM_CR1_CEN;
    static const uint8_t pins[] = {9, 11, 13, 14};
    for (unsigned i = 0; i < sizeof pins; i++) {
        pin_alternate(PORT_E, pins[i], 1, PULL_DOWN, false);
    }
    board_drivers(NULL, false);
    pin_output(PORT_E, 8);
    pin_output(PORT_E, 10);
}

/* Set ENA and ENB; if they are low, the outputs of the bridges are open. */
void board_drivers(board_t *board, bool enabled) {
    pin_write(PORT_E, 8, enabled);
    pin_write(PORT_E, 10, enabled);
}

static void motor(volatile uint32_t *forward, volatile uint32_t *backward, int16_t duty) {
    const uint32_t size = (uint32_t)(duty < 0 ? -(int32_t)duty : duty);
    const uint32_t width = (size * PWM_TOP + BOARD_DUTY_ONE / 2u) / BOARD_DUTY_ONE;
    *forward = duty > 0 ? width : 0;
    *backward = duty < 0 ? width : 0;
}

void board_motors(board_t *board, int16_t left, int16_t right) {
    motor(&TIM1->ccr[0], &TIM1->ccr[1], left);
    motor(&TIM1->ccr[2], &TIM1->ccr[3], right);
}

/* Start a timer in encoder mode: every edge of both inputs is counted (18.3.12). A level is valid
 * after eight samples at 84 MHz / 4 / 32 (18.4.1: CKD, 18.4.7: filter 1111), which is 12.2 us. This
 * filter suppresses the ringing after each edge of the H-bridges, which switch 40 000 times per
 * second. At the maximum speed of 0.30 m/s, a level lasts 870 us. */
static void encoder(tim_regs_t *timer) {
    timer->ccmr[0] = 1u << 0 | 15u << 4 | 1u << 8 | 15u << 12; /* inputs TI1, TI2 */
    timer->smcr = TIM_SMCR_ENCODER_BOTH;
    timer->arr = 0xFFFFu;
    timer->cnt = 0;
    timer->cr1 = TIM_CR1_CKD_4 | TIM_CR1_CEN;
}

void encoders_start(void) {
    pin_alternate(ENCODER_LEFT_A, 2, PULL_UP, false);
    pin_alternate(ENCODER_LEFT_B, 2, PULL_UP, false);
    pin_alternate(ENCODER_RIGHT_A, 2, PULL_UP, false);
    pin_alternate(ENCODER_RIGHT_B, 2, PULL_UP, false);
    encoder(TIM3);
    encoder(TIM4);
    TIM4->ccer = TIM_CCER_CCP(1); /* inverted, because the right motor is mounted mirrored */
}

void board_encoders(board_t *board, board_encoders_t *out) {
    out->left = (uint16_t)TIM3->cnt;
    out->right = (uint16_t)TIM4->cnt;
    out->sampled_us = uptime_us();
}
