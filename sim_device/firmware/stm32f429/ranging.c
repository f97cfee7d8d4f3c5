/* Range and contact sensors: the HC-SR04 with a timer capture of the echo's edges, infrared sensors
 * with the ADC, contacts with input pins. RM0090 section 18; HC-SR04 user's manual (ElecFreaks);
 * Sharp OP13008EN. */
#include "cortex_m4.h"
#include "f429.h"
#include "stm32f4.h"

#define CYCLE_MS 60u
#define TRIGGER 4u                  /* PA4 */
#define MM_PER_MS 343u              /* speed of sound at 20 degrees C; the range is half of the path
                                       */
#define ECHO_US_MAX 24000u          /* 4.1 m; 38 ms mean no echo */
#define ULTRASONIC_MM_MIN 20u
#define INFRARED_GAIN_MV_DMM 1225000u /* 0.1225 V m: sim_device/sensors/infrared.py */
#define INFRARED_OFFSET_DMM 62u
#define INFRARED_DMM_MIN 400u
#define INFRARED_DMM_MAX 3000u

void tim5_handler(void);

static volatile uint16_t newest_mm = BOARD_NO_RANGE;
static volatile uint32_t newest_us; /* time of the pulse of newest_mm */
static volatile bool answered;
static uint32_t cycle_ms;

/* Start TIM5, which counts microseconds. Channel 1 captures the rising edge of the echo, channel 2
 * the falling edge on the same input (18.3.6). */
void sonar_start(void) {
    pin_output(PORT_A, TRIGGER);
    pin_alternate(PORT_A, 0, 2, PULL_DOWN, false);
    TIM5->psc = TIMER_APB1_HZ / 1000000u - 1u;
    TIM5->arr = 0xFFFFFFFFu;
    TIM5->egr = TIM_EGR_UG;
    TIM5->ccmr[0] = 1u << 0 | 3u << 4 | 2u << 8 | 3u << 12; /* IC1 on TI1, IC2 on TI1, filtered */
    TIM5->ccer = TIM_CCER_CCE(1) | TIM_CCER_CCE(2) | TIM_CCER_CCP(2);
    TIM5->dier = TIM_DIER_CCIE(2);
    TIM5->sr = 0;
    TIM5->cr1 = TIM_CR1_CEN;
    nvic_enable(IRQ_TIM5, LEVEL_ECHO);
}

/* A falling edge. Without a rising edge before it, for example if the echo began before
 * sonar_start(), it is ignored. 18.4.5: reading CCR1 clears CC1IF. */
void tim5_handler(void) {
    const bool rose = (TIM5->sr & TIM_SR_CCIF(1)) != 0;
    TIM5->sr = ~TIM_SR_CCIF(2);
    const uint32_t rose_us = TIM5->ccr[0]; /* the rising edge is the time of the pulse */
    if (!rose) {
        return;
    }
    const uint32_t lasted_us = TIM5->ccr[1] - rose_us;
    answered = true;
    newest_us = uptime_us() - (TIM5->cnt - rose_us);
    if (lasted_us > ECHO_US_MAX) {
        newest_mm = BOARD_NO_RANGE;
        return;
    }
    const uint32_t mm = lasted_us * MM_PER_MS / 2000u;
    newest_mm = (uint16_t)(mm < ULTRASONIC_MM_MIN ? ULTRASONIC_MM_MIN : mm);
}

/* Set the trigger; called once per millisecond. It is high for the first millisecond of each cycle
 * (the minimum is ten microseconds). */
void sonar_millisecond(void) {
    pin_write(PORT_A, TRIGGER, cycle_ms == 0);
    if (++cycle_ms >= CYCLE_MS) {
        cycle_ms = 0;
        if (!answered) {
            newest_mm = BOARD_NO_RANGE; /* no sensor connected */
            newest_us = uptime_us() - CYCLE_MS * 1000u;
        }
        answered = false;
    }
}

uint16_t sonar_mm(void) { return newest_mm; }

/* Convert a voltage to a range with the curve of white paper; see
 * sim_device/sensors/infrared.py. */
static uint16_t infrared_dmm(uint32_t mv) {
    if (mv == 0) {
        return BOARD_NO_RANGE;
    }
    const uint32_t beyond = INFRARED_GAIN_MV_DMM / mv;
    const uint32_t dmm = beyond > INFRARED_OFFSET_DMM ? beyond - INFRARED_OFFSET_DMM : 0;
    if (dmm > INFRARED_DMM_MAX) {
        return BOARD_NO_RANGE;
    }
    return (uint16_t)(dmm < INFRARED_DMM_MIN ? INFRARED_DMM_MIN : dmm);
}

void board_ranges(board_t *board, board_ranges_t *out) {
    const uint32_t state = irq_save(); /* so that range and time belong to the same pulse */
    out->ultrasonic_mm = sonar_mm();
    out->ultrasonic_us = newest_us;
    irq_restore(state);
    out->infrared_left_dmm = infrared_dmm(analog_mv(ANALOG_INFRARED_LEFT));
    out->infrared_right_dmm = infrared_dmm(analog_mv(ANALOG_INFRARED_RIGHT));
    out->sampled_us = analog_sampled_us();
}

uint8_t board_contacts(board_t *board) {
    const bool no_floor = pin_read(PORT_F, 0) || pin_read(PORT_F, 1) || pin_read(PORT_F, 2);
    return (uint8_t)((pin_read(PORT_F, 3) ? 0 : SP_CONTACT_BUMPER_LEFT) |
                     (pin_read(PORT_F, 4) ? 0 : SP_CONTACT_BUMPER_RIGHT) |
                     (no_floor ? SP_CONTACT_CLIFF : 0));
}
