#include "phd_messages.h"

/* ------------------------------------------------------------------------------------------------ host -> board */

/* The next number of so many bytes; `at` moves behind it. */
static uint64_t get(const uint8_t **at, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value |= (uint64_t)(*at)[i] << (8 * i);
    *at += bytes;
    return value;
}

static void get_four_u16(const uint8_t **at, uint16_t values[PHD_JOINTS])
{
    for (size_t i = 0; i < PHD_JOINTS; i++)
        values[i] = (uint16_t)get(at, 2);
}

static void get_four_u32(const uint8_t **at, uint32_t values[PHD_JOINTS])
{
    for (size_t i = 0; i < PHD_JOINTS; i++)
        values[i] = (uint32_t)get(at, 4);
}

bool phd_unpack(const uint8_t *payload, size_t n, phd_request *request)
{
    static const uint8_t bytes[] = {0, 2, 25, 22, 18, 1, 5, 1, 1}; /* of each type, from AskHello (1) to Bye (8) */
    static const phd_request empty;
    if (n < 1 || payload[0] < PHD_ASK_HELLO || payload[0] > PHD_BYE || n != bytes[payload[0]])
        return false;
    *request = empty;
    request->type = payload[0];
    const uint8_t *at = payload + 1;
    switch (request->type) {
    case PHD_ASK_HELLO:
        request->version = (uint8_t)get(&at, 1);
        break;
    case PHD_SET_LIMITS:
        get_four_u16(&at, request->limits.current_mA);
        get_four_u32(&at, request->limits.speed_counts_s);
        break;
    case PHD_COMMAND:
        request->sequence = (uint32_t)get(&at, 4);
        request->host_us = get(&at, 8);
        request->mode = (uint8_t)get(&at, 1);
        get_four_u16(&at, request->current_mA);
        break;
    case PHD_HOME:
        request->joints = (uint8_t)get(&at, 1);
        get_four_u32(&at, request->counts);
        break;
    case PHD_HEARTBEAT:
        request->token = (uint32_t)get(&at, 4);
        break;
    default: /* ResetFault, Stop, Bye: no fields */
        break;
    }
    return true;
}

/* ------------------------------------------------------------------------------------------------ board -> host */

static uint8_t *put(uint8_t *at, size_t bytes, uint64_t value)
{
    for (size_t i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> (8 * i));
    return at + bytes;
}

static uint8_t *put_text(uint8_t *at, size_t bytes, const char *text)
{
    for (size_t i = 0; i < bytes; i++)
        at[i] = (uint8_t)text[i];
    return at + bytes;
}

size_t phd_pack_hello(uint8_t payload[PHD_MAX_PAYLOAD], const phd_capability *capability, uint8_t state,
                      uint16_t faults, uint16_t cause, uint32_t starts)
{
    uint8_t *at = put(payload, 1, PHD_HELLO);
    at = put(at, 1, PHD_VERSION);
    at = put(at, 1, state);
    at = put(at, 2, faults);
    at = put(at, 2, cause);
    for (size_t i = 0; i < 3; i++)
        at = put(at, 1, capability->firmware[i]);
    at = put(at, 1, capability->encoders);
    at = put(at, 1, capability->brakes);
    at = put(at, 1, capability->force_channels);
    at = put(at, 2, PHD_SAMPLE_HZ);
    at = put(at, 2, PHD_WATCHDOG_MS);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        at = put(at, 4, capability->counts_per_rev[i]);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        at = put(at, 2, capability->current_max_mA[i]);
    at = put(at, 4, capability->force_unit);
    at = put(at, 4, (uint32_t)capability->force_full_scale);
    at = put(at, 4, starts);
    at = put_text(at, sizeof capability->device, capability->device);
    at = put_text(at, sizeof capability->serial, capability->serial);
    return (size_t)(at - payload);
}

size_t phd_pack_limits(uint8_t payload[PHD_MAX_PAYLOAD], const phd_limits *limits)
{
    uint8_t *at = put(payload, 1, PHD_LIMITS);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        at = put(at, 2, limits->current_mA[i]);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        at = put(at, 4, limits->speed_counts_s[i]);
    return (size_t)(at - payload);
}

size_t phd_pack_sample(uint8_t payload[PHD_MAX_PAYLOAD], const phd_capability *capability, const phd_sample *sample)
{
    uint8_t *at = put(payload, 1, PHD_SAMPLE);
    at = put(at, 4, sample->sequence);
    at = put(at, 4, sample->echo);
    at = put(at, 8, sample->board_us);
    at = put(at, 1, sample->state);
    at = put(at, 1, sample->flags);
    at = put(at, 2, sample->faults);
    at = put(at, 2, sample->cause);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        if (capability->encoders >> i & 1)
            at = put(at, 4, sample->counts[i]);
    for (size_t k = 0; k < capability->force_channels; k++)
        at = put(at, 4, sample->force[k]);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        if (capability->brakes >> i & 1)
            at = put(at, 2, sample->current_mA[i]);
    return (size_t)(at - payload);
}

size_t phd_pack_homed(uint8_t payload[PHD_MAX_PAYLOAD], uint8_t joints, const uint32_t counts[PHD_JOINTS])
{
    uint8_t *at = put(payload, 1, PHD_HOMED);
    at = put(at, 1, joints);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        at = put(at, 4, counts[i]);
    return (size_t)(at - payload);
}

size_t phd_pack_fault_report(uint8_t payload[PHD_MAX_PAYLOAD], uint16_t faults, uint16_t cause, uint8_t detail,
                             uint64_t board_us)
{
    uint8_t *at = put(payload, 1, PHD_FAULT_REPORT);
    at = put(at, 2, faults);
    at = put(at, 2, cause);
    at = put(at, 1, detail);
    at = put(at, 8, board_us);
    return (size_t)(at - payload);
}

size_t phd_pack_heartbeat_reply(uint8_t payload[PHD_MAX_PAYLOAD], uint32_t token, uint64_t board_us)
{
    uint8_t *at = put(payload, 1, PHD_HEARTBEAT_REPLY);
    at = put(at, 4, token);
    at = put(at, 8, board_us);
    return (size_t)(at - payload);
}

size_t phd_pack_refused(uint8_t payload[PHD_MAX_PAYLOAD], uint8_t type, uint8_t reason)
{
    uint8_t *at = put(payload, 1, PHD_REFUSED);
    at = put(at, 1, type);
    at = put(at, 1, reason);
    return (size_t)(at - payload);
}
