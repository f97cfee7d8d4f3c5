/* The whole program of a board. */
#include "board.h"
#include "firmware.h"

int main(void)
{
    board_start();
    firmware_boot();
    for (;;) {
        firmware_poll();
        board_idle();
    }
}
