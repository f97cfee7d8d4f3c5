/* Main program of a board. */
#include "board.h"
#include "firmware_state.h"

static firmware_t firmware;

int main(void)
{
    board_start(&firmware);
    firmware_boot(&firmware, NULL);
    for (;;) {
        firmware_poll(&firmware);
        board_idle();
    }
}
