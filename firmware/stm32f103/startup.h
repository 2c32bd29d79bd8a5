// The interrupt handlers in the vector table, and the software reset.
#ifndef FMFTS_STARTUP_H
#define FMFTS_STARTUP_H

void reset_handler(void);
void systick_handler(void);
void usart1_handler(void);
void nmi_handler(void);

_Noreturn void system_reset(void);

int main(void);

#endif
