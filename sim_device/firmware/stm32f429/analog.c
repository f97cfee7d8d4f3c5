/* Analog inputs. ADC1 converts its six channels continuously (RM0090 section 13); DMA2 stream 0
 * (channel 0, table 43) stores the last rounds. One conversion takes 144 + 12 clocks of 21 MHz, a
 * round of six channels 45 us. A round is not synchronous with the PWM period, so the mean of the
 * motor currents covers all phases of the PWM. */
#include "f429.h"
#include "stm32f4.h"

#define SETS 64u
#define TURNS 100u
#define REFERENCE_MV 3300u
#define FULL_SCALE 4095u
#define BATTERY_RATIO 6u         /* 1:6: 16 V at 2.7 V */
#define LOGIC_RATIO 2u           /* 1:2 */
#define CURRENT_MA_PER_MV 1u     /* 0.1 ohm, amplified ten times: 1 V/A */

static volatile uint16_t samples[SETS][ANALOG_COUNT];
static const struct {
    uint8_t port, pin, channel;
} inputs[ANALOG_COUNT] = ANALOG_INPUTS;
static uint32_t to_come; /* number of remaining conversions of all rounds, one millisecond ago */
static uint32_t fresh_us; /* time of the last new conversions */

static void start_rounds(void) {
    dma_stream_t *const stream = &DMA2->stream[0];
    stream->cr = 0; /* before the ADC: 10.3.17 */
    for (unsigned i = 0; i < TURNS && (stream->cr & DMA_CR_EN) != 0; i++) {
    }
    ADC1->cr2 = 0; /* so that the next round begins with the first channel */
    dma_clear_flags(DMA2, 0);
    ADC1->sr = 0;
    stream->par = (uint32_t)(uintptr_t)&ADC1->dr;
    stream->m0ar = (uint32_t)(uintptr_t)samples;
    stream->ndtr = SETS * ANALOG_COUNT;
    stream->cr = DMA_CR_CHSEL(0) | DMA_CR_MSIZE_16 | DMA_CR_PSIZE_16 | DMA_CR_MINC | DMA_CR_CIRC |
                 DMA_CR_EN;
    ADC1->cr2 = ADC_CR2_ADON | ADC_CR2_CONT | ADC_CR2_DMA | ADC_CR2_DDS;
    const uint32_t from_us = uptime_us();
    while (uptime_us() - from_us < 5u) { /* t_STAB: 3 us, data sheet table 74 */
    }
    ADC1->cr2 |= ADC_CR2_SWSTART;
}

void analog_start(void) {
    for (unsigned i = 0; i < ANALOG_COUNT; i++) {
        pin_analog(inputs[i].port, inputs[i].pin);
    }
    for (unsigned pin = 0; pin <= 4u; pin++) {
        pin_input(PORT_F, pin, PULL_UP);
    }
    ADC_CCR = ADC_CCR_PRESCALE_4; /* of 84 MHz */
    ADC1->cr1 = ADC_CR1_SCAN;
    uint32_t order[3] = {(ANALOG_COUNT - 1u) << 20, 0, 0}; /* SQR1, SQR2, SQR3: 13.13.9 to 11 */
    for (unsigned i = 0; i < ANALOG_COUNT; i++) {
        const unsigned channel = inputs[i].channel;
        order[2] |= (uint32_t)channel << (5u * i);
        if (channel >= 10u) {
            ADC1->smpr1 |= ADC_SAMPLE_144 << (3u * (channel - 10u));
        } else {
            ADC1->smpr2 |= ADC_SAMPLE_144 << (3u * channel);
        }
    }
    for (unsigned i = 0; i < 3u; i++) {
        ADC1->sqr[i] = order[i];
    }
    start_rounds();
}

/* Restart the ADC after an overrun; called once per millisecond. On a busy bus an overrun may
 * occur. 13.8.1: the ADC then requests no DMA until OVR is cleared and the stream is set up again.
 * Without a restart, the readings would not change any more. */
void analog_millisecond(void) {
    const uint32_t left = DMA2->stream[0].ndtr;
    if ((ADC1->sr & ADC_SR_OVR) != 0) {
        start_rounds();
    } else if (left != to_come) {
        fresh_us = uptime_us();
    }
    to_come = left;
}

/* Return the middle of the mean's time interval; it does not change if the ADC has stopped. */
uint32_t analog_sampled_us(void) { return fresh_us - ANALOG_AGE_US; }

uint32_t analog_mv(unsigned channel) {
    uint32_t sum = 0;
    for (unsigned i = 0; i < SETS; i++) {
        sum += samples[i][channel];
    }
    return sum * REFERENCE_MV / (SETS * FULL_SCALE);
}

void board_power(board_t *board, board_power_t *out) {
    out->battery_mv = (uint16_t)(analog_mv(ANALOG_BATTERY) * BATTERY_RATIO);
    out->logic_mv = (uint16_t)(analog_mv(ANALOG_LOGIC) * LOGIC_RATIO);
    out->motor_left_ma = (uint16_t)(analog_mv(ANALOG_MOTOR_LEFT) * CURRENT_MA_PER_MV);
    out->motor_right_ma = (uint16_t)(analog_mv(ANALOG_MOTOR_RIGHT) * CURRENT_MA_PER_MV);
    out->sampled_us = analog_sampled_us();
}
