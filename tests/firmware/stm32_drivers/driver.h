// What the small I2C drivers of these tests share: the registers they need, and the parts that all of them do right.
#ifndef DRIVER_H
#define DRIVER_H

#include <stdbool.h>
#include <stdint.h>

struct i2c {
    volatile uint32_t CR1, CR2, OAR1, OAR2, DR, SR1, SR2, CCR, TRISE;
};
struct gpio {
    volatile uint32_t CRL, CRH, IDR, ODR, BSRR, BRR;
};
#define I2C1 ((struct i2c *)0x40005400)
#define GPIOB ((struct gpio *)0x40010C00)
enum {
    PE = 1 << 0, START = 1 << 8, STOP = 1 << 9, ACK = 1 << 10, POS = 1 << 11, SWRST = 1 << 15,
    SB = 1 << 0, ADDR = 1 << 1, BTF = 1 << 2, RXNE = 1 << 6, TXE = 1 << 7, AF = 1 << 10, BUSY = 1 << 1,
    SCL = 6, SDA = 7,
    MUX = 0x70, SENSOR = 0x1E, IDENTIFICATION = 0x0A, // its registers A, B and C read `H43`
};

// The test reads this at the start of RAM.
extern struct result {
    uint32_t finished, failed;
    uint8_t bytes[64];
} result;

void scenario(void); // the part that each driver tests; the rest is in driver.c

void start_port(void);
bool await(uint32_t flags);                   // false, and counts in `failed`, without these flags
bool call(uint8_t address, bool reading);     // (repeated) START and address; ends with ADDR set
bool transmit(uint8_t address, uint8_t byte); // ends with BTF set: no STOP yet
void stop(void);
void select_channels(uint8_t channels);
void point_at(uint8_t number); // sets the sensor's register pointer

#endif
