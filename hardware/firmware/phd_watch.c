#include "phd_board.h"

/* The distance of a number in two's complement from zero: right for the most negative one as well. */
static uint32_t magnitude(uint32_t value)
{
    return value & 0x80000000u ? 0u - value : value;
}

static void remember(phd_watch *watch, const phd_readings *readings)
{
    watch->newest = (uint8_t)((watch->newest + 1) % (PHD_SPEED_TICKS + 1));
    if (watch->ticks <= PHD_SPEED_TICKS)
        watch->ticks++;
    for (size_t i = 0; i < PHD_JOINTS; i++)
        watch->past[watch->newest][i] = (uint32_t)readings->counts[i];
}

/* Differences of counts are taken modulo 2^32: a counter that goes round is no speed. */
static bool too_fast(const phd_watch *watch, size_t joint, uint32_t most)
{
    if (most == 0 || watch->ticks <= PHD_SPEED_TICKS)
        return false;
    size_t oldest = (watch->newest + (size_t)1) % (PHD_SPEED_TICKS + 1);
    uint32_t moved = magnitude(watch->past[watch->newest][joint] - watch->past[oldest][joint]);
    return (uint64_t)moved * PHD_SAMPLE_HZ > (uint64_t)most * PHD_SPEED_TICKS;
}

/* Count the ticks on end of something bad; true once there are enough. */
static bool lasts(uint8_t *ticks, bool bad, uint8_t enough)
{
    if (!bad)
        *ticks = 0;
    else if (*ticks < enough)
        ++*ticks;
    return *ticks >= enough;
}

size_t phd_watch_look(phd_watch *watch, const phd_capability *capability, const phd_limits *limits,
                      const phd_readings *readings, phd_condition found[PHD_MAX_CONDITIONS])
{
    size_t n = 0;
    remember(watch, readings);
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        if (!(capability->brakes >> i & 1))
            continue;
        uint32_t limit = limits->current_mA[i];
        bool over = magnitude((uint32_t)(int32_t)readings->current_mA[i]) > limit + limit / 10 + PHD_OVER_CURRENT_mA;
        if (lasts(&watch->over_current[i], over, PHD_OVER_CURRENT_TICKS))
            found[n++] = (phd_condition){PHD_FAULT_OVER_CURRENT, (uint8_t)i};
    }
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        if (!(capability->encoders >> i & 1))
            continue;
        if (too_fast(watch, i, limits->speed_counts_s[i]))
            found[n++] = (phd_condition){PHD_FAULT_OVER_SPEED, (uint8_t)i};
        if (!readings->encoder_good[i])
            found[n++] = (phd_condition){PHD_FAULT_BAD_ENCODER, (uint8_t)i};
    }
    size_t channel = 0;
    while (channel < capability->force_channels
           && magnitude((uint32_t)readings->force[channel]) < (uint32_t)capability->force_full_scale)
        channel++;
    if (lasts(&watch->saturated, channel < capability->force_channels, PHD_SATURATED_TICKS))
        found[n++] = (phd_condition){PHD_FAULT_FORCE_SATURATED, (uint8_t)channel};
    return n;
}
