/* What the inputs read at a tick, and the conditions among them that latch a fault (docs/protocol.md, "Faults"). */
#ifndef PHD_WATCH_H
#define PHD_WATCH_H

#include "phd_messages.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PHD_SPEED_TICKS = 10, PHD_OVER_CURRENT_TICKS = 10, PHD_SATURATED_TICKS = 5, PHD_OVER_CURRENT_mA = 100 };
enum { PHD_MAX_CONDITIONS = 3 * PHD_JOINTS + 1 };

/* For each joint, in the order A, E, B, C; 0 and true where there is nothing. */
typedef struct {
    int32_t counts[PHD_JOINTS];        /* as the encoders count, before homing; they may go round at 2^31 */
    int32_t force[PHD_MAX_FORCE];
    int16_t current_mA[PHD_JOINTS];    /* measured */
    bool encoder_good[PHD_JOINTS];     /* what the encoder's interface says of its signal */
} phd_readings;

PHD_ASSERT(ticks_fit_a_byte, PHD_SPEED_TICKS < 255 && PHD_OVER_CURRENT_TICKS < 256 && PHD_SATURATED_TICKS < 256);

typedef struct {
    uint16_t fault;
    uint8_t detail;                    /* joint or force channel */
} phd_condition;

typedef struct {
    uint32_t past[PHD_SPEED_TICKS + 1][PHD_JOINTS]; /* counts of the last ticks, a ring */
    uint8_t newest, ticks;                          /* where the newest stand; how many there are */
    uint8_t over_current[PHD_JOINTS], saturated;    /* ticks on end, up to where it is a fault */
} phd_watch;

void phd_watch_init(phd_watch *watch);

/* Look at one tick's readings; how many conditions were found. To be called every tick. */
size_t phd_watch_look(phd_watch *watch, const phd_capability *capability, const phd_limits *limits,
                      const phd_readings *readings, phd_condition found[PHD_MAX_CONDITIONS]);

#ifdef __cplusplus
}
#endif

#endif
