/* Driver of CAN1 at 500 kbit/s (RM0090 section 32). */
#include "cortex_m4.h"
#include "f429.h"
#include "firmware.h"
#include "stm32f4.h"

/* Bit timing: 42 MHz / 6 = 7 MHz gives 14 time quanta per bit, 1 + 11 before the sample point (86
 * %) and 2 after it. */
#define PRESCALER 6u
#define BEFORE 11u
#define AFTER 2u
#define TURNS 100000u

/* Bits of a 16-bit filter (32.7.4, figure 342): identifier 15:5, RTR 4, IDE 3. The node is the low
 * four bits of the identifier. Only data frames with an 11-bit identifier pass. */
#define FILTER(node) ((uint32_t)(node) << 5)
#define FILTER_MASK (0xFu << 5 | 1u << 4 | 1u << 3)

/* Number of frames in the driver's queue, which keeps the bus busy while the main loop is busy. The
 * queue is small, because it is not ordered by priority as the core's queue is. Together with the
 * mailboxes it has 7 frames, which take 1.8 ms. */
#define WAITING 4u

void can1_rx0_handler(void);
void can1_tx_handler(void);
void can1_sce_handler(void);

/* The main loop and the interrupts change these variables. The main loop masks the interrupts while
 * it uses them. */
static sp_can_frame_t waiting[WAITING];
static uint8_t first, count;
static volatile uint16_t bus_offs;

void can_start(uint8_t node) {
    pin_alternate(CAN_RX, 9, PULL_UP, false);
    pin_alternate(CAN_TX, 9, PULL_NONE, false);
    CAN1->mcr = CAN_MCR_INRQ; /* also ends sleep mode */
    for (uint32_t i = 0; i < TURNS && (CAN1->msr & CAN_MSR_INAK) == 0; i++) {
    }
    /* Frames are sent in the order of their requests (TXFP); the controller ends bus-off by itself
     * (ABOM). */
    CAN1->mcr = CAN_MCR_INRQ | CAN_MCR_TXFP | CAN_MCR_ABOM;
    CAN1->btr = (AFTER - 1u) << 20 | (BEFORE - 1u) << 16 | (PRESCALER - 1u); /* jump: one, 00 */
    CAN1->fmr |= CAN_FMR_FINIT;
    CAN1->fm1r &= ~1u; /* bank 0: masks */
    CAN1->fs1r &= ~1u; /* two of 16 bits */
    CAN1->ffa1r &= ~1u;
    CAN1->filter[0].fr1 = FILTER_MASK << 16 | FILTER(node);
    CAN1->filter[0].fr2 = FILTER_MASK << 16 | FILTER(0); /* for all nodes */
    CAN1->fa1r |= 1u;
    CAN1->fmr &= ~CAN_FMR_FINIT;
    CAN1->mcr &= ~CAN_MCR_INRQ; /* the controller is active after 11 recessive bits; the program
                                   does not wait for this */
    CAN1->ier = CAN_IER_FMPIE0 | CAN_IER_TMEIE | CAN_IER_BOFIE | CAN_IER_ERRIE;
    nvic_enable(IRQ_CAN1_RX0, LEVEL_LINK); /* one priority level for all three, so that they do not
                                              interrupt each other */
    nvic_enable(IRQ_CAN1_TX, LEVEL_LINK);
    nvic_enable(IRQ_CAN1_SCE, LEVEL_LINK);
}

void can1_rx0_handler(void) {
    const uint32_t now_us = uptime_us();
    while ((CAN1->rfr[0] & CAN_RFR_FMP_MASK) != 0) {
        const can_mailbox_t *const box = &CAN1->rx[0];
        const uint32_t words[2] = {box->dlr, box->dhr};
        const uint32_t length = box->dtr & 15u;
        sp_can_frame_t frame = {.id = (uint16_t)(box->ir >> CAN_IR_STID_SHIFT),
            .length = (uint8_t)(length < 8u ? length : 8u)};
        for (unsigned i = 0; i < 8u; i++) {
            frame.data[i] = (uint8_t)(words[i / 4u] >> (8u * (i % 4u)));
        }
        const bool overrun = (CAN1->rfr[0] & CAN_RFR_FOVR) != 0;
        CAN1->rfr[0] = CAN_RFR_RFOM | CAN_RFR_FOVR;
        firmware_can_received(device, &frame, now_us);
        if (overrun) {
            firmware_can_lost(device); /* one or more: the controller does not count them */
        }
    }
}

static void put(can_mailbox_t *box, const sp_can_frame_t *frame) {
    uint32_t words[2] = {0, 0};
    for (unsigned i = 0; i < frame->length; i++) {
        words[i / 4u] |= (uint32_t)frame->data[i] << (8u * (i % 4u));
    }
    box->dtr = frame->length;
    box->dlr = words[0];
    box->dhr = words[1];
    box->ir = (uint32_t)frame->id << CAN_IR_STID_SHIFT | CAN_IR_TXRQ;
}

/* Fill empty mailboxes. Called with interrupts masked, or in the mailbox interrupt. */
static void fill_mailboxes(uint32_t tsr) {
    for (unsigned i = 0; i < CAN_MAILBOXES && count != 0; i++) {
        if ((tsr & CAN_TSR_TME(i)) != 0) {
            put(&CAN1->tx[i], &waiting[first]);
            first = (uint8_t)((first + 1u) % WAITING);
            count--;
        }
    }
}

/* Interrupt: a mailbox is empty. The interrupt also wakes the main loop, which has further
 * frames. */
void can1_tx_handler(void) {
    const uint32_t tsr = CAN1->tsr;
    CAN1->tsr = tsr & (CAN_TSR_RQCP(0) | CAN_TSR_RQCP(1) | CAN_TSR_RQCP(2));
    fill_mailboxes(tsr);
}

/* Interrupt: bus-off. The controller recovers by itself after 128 times 11 recessive bits (ABOM).
 * The queued frames are dropped, because their stamps may be too old to be extended after the
 * recovery. */
void can1_sce_handler(void) {
    CAN1->msr = CAN_MSR_ERRI;
    if ((CAN1->esr & CAN_ESR_BOFF) != 0) {
        bus_offs++;
        count = 0;
        CAN1->tsr = CAN_TSR_ABRQ(0) | CAN_TSR_ABRQ(1) | CAN_TSR_ABRQ(2);
    }
}

/* Return true if every frame has been sent. */
bool can_drained(void) {
    const uint32_t state = irq_save();
    const uint32_t empty = CAN_TSR_TME(0) | CAN_TSR_TME(1) | CAN_TSR_TME(2);
    const bool drained = count == 0 && (CAN1->tsr & empty) == empty;
    irq_restore(state);
    return drained;
}

bool board_can_write(board_t *board, const sp_can_frame_t *frame) {
    const uint32_t state = irq_save();
    const bool room = count < WAITING;
    if (room) {
        waiting[(first + count) % WAITING] = *frame;
        count++;
        fill_mailboxes(CAN1->tsr);
    }
    irq_restore(state);
    return room;
}

void board_can_health(board_t *board, board_can_health_t *out) {
    const uint32_t esr = CAN1->esr;
    out->send_errors = (uint8_t)CAN_ESR_TEC(esr);
    out->receive_errors = (uint8_t)CAN_ESR_REC(esr);
    out->off = (esr & CAN_ESR_BOFF) != 0;
    out->offs = bus_offs;
}
