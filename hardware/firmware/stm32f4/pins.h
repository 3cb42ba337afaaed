/* Which pin is wired to what: the one table, from which the pins are set up and README.md has its pin map. */
#ifndef PINS_H
#define PINS_H

#include <stdbool.h>
#include <stdint.h>

enum pin_port { A, B, C, D };
enum pin_mode { IN, OUT, PERIPHERAL, ANALOG };
enum pin_pull { NONE, UP, DOWN };

/* name, port, number, mode, function of the peripheral, pull inside the chip, place on the NUCLEO-F446RE, wired to */
#define PINS(PIN)                                                                                                      \
    PIN(ENCODER_A_1, A, 15, PERIPHERAL, 1, UP, "CN7-17", "encoder of joint A, channel A (TIM2)")                       \
    PIN(ENCODER_A_2, B, 3, PERIPHERAL, 1, UP, "CN10-31", "encoder of joint A, channel B (TIM2)")                       \
    PIN(ENCODER_E_1, B, 4, PERIPHERAL, 2, UP, "CN10-27", "encoder of joint E, channel A (TIM3)")                       \
    PIN(ENCODER_E_2, B, 5, PERIPHERAL, 2, UP, "CN10-29", "encoder of joint E, channel B (TIM3)")                       \
    PIN(ENCODER_B_1, A, 0, PERIPHERAL, 2, UP, "CN7-28", "encoder of joint B, channel A (TIM5)")                        \
    PIN(ENCODER_B_2, A, 1, PERIPHERAL, 2, UP, "CN7-30", "encoder of joint B, channel B (TIM5)")                        \
    PIN(ENCODER_C_1, B, 6, PERIPHERAL, 2, UP, "CN10-17", "encoder of joint C, channel A (TIM4)")                       \
    PIN(ENCODER_C_2, B, 7, PERIPHERAL, 2, UP, "CN7-21", "encoder of joint C, channel B (TIM4)")                        \
    PIN(WIRE_A, C, 10, IN, 0, UP, "CN7-1", "fault output of the line receiver of A: high, or not wired, is a fault")   \
    PIN(WIRE_E, C, 11, IN, 0, UP, "CN7-2", "the same of E")                                                            \
    PIN(WIRE_B, C, 12, IN, 0, UP, "CN7-3", "the same of B")                                                            \
    PIN(WIRE_C, D, 2, IN, 0, UP, "CN7-4", "the same of C")                                                             \
    PIN(BRAKE_A, C, 6, PERIPHERAL, 3, DOWN, "CN10-4", "amplifier of brake A, PWM of 20 kHz (TIM8); 10 kohm to ground") \
    PIN(BRAKE_E, C, 7, PERIPHERAL, 3, DOWN, "CN10-19", "amplifier of brake E, likewise")                               \
    PIN(BRAKE_B, C, 8, PERIPHERAL, 3, DOWN, "CN10-2", "amplifier of brake B, likewise")                                \
    PIN(BRAKE_C, C, 9, PERIPHERAL, 3, DOWN, "CN10-1", "amplifier of brake C, likewise")                                \
    PIN(ENABLE, B, 0, OUT, 0, DOWN, "CN7-34", "enable of all four amplifiers; 10 kohm to ground: low in a reset")      \
    PIN(SENSE_A, C, 0, ANALOG, 0, NONE, "CN7-38", "current of brake A, 2 V/A (ADC1)")                                  \
    PIN(SENSE_E, C, 1, ANALOG, 0, NONE, "CN7-36", "current of brake E, 2 V/A (ADC1)")                                  \
    PIN(SENSE_B, C, 2, ANALOG, 0, NONE, "CN7-35", "current of brake B, 2 V/A (ADC1)")                                  \
    PIN(SENSE_C, C, 3, ANALOG, 0, NONE, "CN7-37", "current of brake C, 2 V/A (ADC1)")                                  \
    PIN(FORCE_CLOCK, B, 13, PERIPHERAL, 5, NONE, "CN10-30", "force converter AD7606, SCLK (SPI2)")                     \
    PIN(FORCE_DATA, B, 14, PERIPHERAL, 5, DOWN, "CN10-28", "force converter, DOUTA (SPI2)")                            \
    PIN(FORCE_SELECT, B, 12, OUT, 0, UP, "CN10-16", "force converter, CS")                                             \
    PIN(FORCE_CONVERT, B, 1, OUT, 0, DOWN, "CN10-24", "force converter, CONVST A and B")                               \
    PIN(FORCE_BUSY, C, 4, IN, 0, DOWN, "CN10-34", "force converter, BUSY")                                             \
    PIN(FORCE_RESET, C, 5, OUT, 0, DOWN, "CN10-6", "force converter, RESET")                                           \
    PIN(ESTOP, A, 4, IN, 0, UP, "CN7-32", "auxiliary contact of the e-stop's relay to ground: open, or not wired, is cut") \
    PIN(HOST_TX, A, 2, PERIPHERAL, 7, NONE, "CN10-35", "host by UART: ST-LINK's port, USART2; on the Nucleo already")   \
    PIN(HOST_RX, A, 3, PERIPHERAL, 7, UP, "CN10-37", "the same, from the host")                                        \
    PIN(USB_MINUS, A, 11, PERIPHERAL, 10, NONE, "CN10-14", "USB D-, host by USB")                                      \
    PIN(USB_PLUS, A, 12, PERIPHERAL, 10, NONE, "CN10-12", "USB D+, host by USB")                                       \
    PIN(LIGHT, A, 5, OUT, 0, NONE, "CN10-11", "green light of the Nucleo (LD2): the state")                            \
    PIN(RED_LIGHT, B, 10, OUT, 0, NONE, "CN10-25", "red light, 1 kohm to ground: a fault, or the supply is cut")

enum pin {
#define PIN(name, ...) PIN_##name,
    PINS(PIN)
#undef PIN
    PIN_COUNT
};

void pins_begin(void);
void pin_set(enum pin pin, bool high);
bool pin_is_high(enum pin pin);

#endif
