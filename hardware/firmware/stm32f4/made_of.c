/* What this board is made of and wired to: set it for your bench. */
#include "board.h"
#include "registers.h"

static phd_capability made_of = {
    .encoders = 5, /* joints A and B */
    .brakes = 15,
    .force_channels = PHD_MAX_FORCE, /* 0: a Net F/T reads the force */
    .firmware = {1, 0, 0},
    .counts_per_rev = {96000, 0, 96000, 0},
    .current_max_mA = {1000, 1000, 1000, 1000},
    .force_unit = 305, /* 10 V of 32768 steps, in microvolts: the matrix of the device file makes newtons of volts */
    .force_full_scale = 32700, /* of 32767 */
    .device = "four-brake",
};

const phd_capability *capability(void)
{
    static const char digits[] = "0123456789ABCDEF";
    uint32_t number = UNIQUE_ID(0) ^ UNIQUE_ID(1) ^ UNIQUE_ID(2); /* of the chip */
    for (unsigned i = 0; i < 8; i++)
        made_of.serial[i] = digits[number >> (28 - 4 * i) & 15];
    return &made_of;
}
