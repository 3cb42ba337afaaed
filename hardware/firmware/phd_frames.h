/* Frames on the wire: COBS around payload and CRC-32, a zero byte after each (docs/protocol.md, "Frames"). */
#ifndef PHD_FRAMES_H
#define PHD_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    PHD_MAX_PAYLOAD = 124,                                   /* bytes: message type and fields */
    PHD_CRC_BYTES = 4,
    PHD_MAX_ENCODED = PHD_MAX_PAYLOAD + PHD_CRC_BYTES + 1,   /* of a frame before its zero byte */
    PHD_MAX_FRAME = PHD_MAX_ENCODED + 1
};

/* What must hold for the processor that this is compiled for, or it does not compile; C99 has no _Static_assert. */
#define PHD_ASSERT(name, holds) typedef char phd_assert_##name[(holds) ? 1 : -1]
/* Has the value that docs/protocol.md says, and a type that calculates with 32 bits where an int has 16. */
#define PHD_ASSERT_U32(name, is, value) PHD_ASSERT(name, (is) == (value) && sizeof(is) == 4 && 0 - (is) > 0)
PHD_ASSERT(one_cobs_code, PHD_MAX_ENCODED < 255);

/* CRC-32 as in Ethernet and zlib; of the nine bytes "123456789" it is 0xCBF43926. */
uint32_t phd_crc32(const uint8_t *data, size_t n);

/* Write the frame of a payload, zero byte included; its length, or 0 if n is not in 1 .. PHD_MAX_PAYLOAD. */
size_t phd_encode_frame(const uint8_t *payload, size_t n, uint8_t frame[PHD_MAX_FRAME]);

typedef struct {
    uint8_t bytes[PHD_MAX_ENCODED]; /* what came since the last zero byte; a proven payload when one is complete */
    size_t n;
    bool skipping;                  /* until the next zero byte: what came was too long */
    uint32_t good, bad_cobs, bad_crc, too_long;
} phd_decoder;

void phd_decoder_init(phd_decoder *decoder);

/* Take in one byte. The length of the payload that it completes, which stands in decoder->bytes until the next byte;
 * or 0: none yet, or none that was proven by its CRC. */
size_t phd_decode(phd_decoder *decoder, uint8_t byte);

#ifdef __cplusplus
}
#endif

#endif
