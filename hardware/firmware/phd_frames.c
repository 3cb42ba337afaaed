#include "phd_board.h"

uint32_t phd_crc32(const uint8_t *data, size_t n)
{
    static const uint32_t of_nibble[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < n; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ of_nibble[crc & 15u];
        crc = (crc >> 4) ^ of_nibble[crc & 15u];
    }
    return crc ^ 0xFFFFFFFFu;
}

size_t phd_encode_frame(const uint8_t *payload, size_t n, uint8_t frame[PHD_MAX_FRAME])
{
    if (n < 1 || n > PHD_MAX_PAYLOAD)
        return 0;
    uint32_t crc = phd_crc32(payload, n);
    size_t code_at = 0; /* where the way to the next zero byte will stand; below 255, since 128 bytes are the most */
    size_t at = 1;
    for (size_t i = 0; i < n + PHD_CRC_BYTES; i++) {
        uint8_t byte = (uint8_t)(i < n ? payload[i] : crc >> (8 * (i - n)));
        if (byte != 0) {
            frame[at++] = byte;
        } else {
            frame[code_at] = (uint8_t)(at - code_at);
            code_at = at++;
        }
    }
    frame[code_at] = (uint8_t)(at - code_at);
    frame[at++] = 0;
    return at;
}

/* Undo COBS in place; the length that is left, 0 where a code points beyond the end. No byte may be zero. */
static size_t unstuff(uint8_t *bytes, size_t n)
{
    size_t from = 0, to = 0;
    while (from < n) {
        size_t run = bytes[from++] - (size_t)1;
        if (run > n - from)
            return 0;
        while (run-- > 0)
            bytes[to++] = bytes[from++];
        if (from < n)
            bytes[to++] = 0;
    }
    return to;
}

/* What stands between two zero bytes: the length of its payload, or 0. */
static size_t finish(phd_decoder *decoder)
{
    size_t n = unstuff(decoder->bytes, decoder->n);
    if (n <= PHD_CRC_BYTES) {
        decoder->bad_cobs++;
        return 0;
    }
    n -= PHD_CRC_BYTES;
    uint32_t crc = 0;
    for (size_t i = 0; i < PHD_CRC_BYTES; i++)
        crc |= (uint32_t)decoder->bytes[n + i] << (8 * i);
    if (crc != phd_crc32(decoder->bytes, n)) {
        decoder->bad_crc++;
        return 0;
    }
    decoder->good++;
    return n;
}

size_t phd_decode(phd_decoder *decoder, uint8_t byte)
{
    size_t payload = 0;
    if (byte == 0) {
        if (decoder->n > 0 && !decoder->skipping) /* two zero bytes in a row are no error */
            payload = finish(decoder);
        decoder->n = 0;
        decoder->skipping = false;
    } else if (decoder->n < PHD_MAX_ENCODED) {
        decoder->bytes[decoder->n++] = byte;
    } else if (!decoder->skipping) {
        decoder->too_long++;
        decoder->skipping = true;
    }
    return payload;
}
