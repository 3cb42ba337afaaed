/* Frames on the wire: COBS around payload and CRC-32, a zero byte after each (docs/protocol.md, "Frames"). */
#ifndef PHD_FRAMES_H
#define PHD_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    PHD_MAX_PAYLOAD = 124,                                   /* bytes: message type and fields */
    PHD_CRC_BYTES = 4,
    PHD_MAX_ENCODED = PHD_MAX_PAYLOAD + PHD_CRC_BYTES + 1,   /* of a frame before its zero byte */
    PHD_MAX_FRAME = PHD_MAX_ENCODED + 1
};

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

#endif
