#ifndef START_H
#define START_H

#include <stdint.h>

uint32_t stack_deepest(void); /* bytes of stack that were ever in use since reset */

#endif
