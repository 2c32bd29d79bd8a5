#ifndef FMFTS_RP2040_STARTUP_H
#define FMFTS_RP2040_STARTUP_H

int main(void);
void uart0_handler(void);
void usbctrl_handler(void);
_Noreturn void system_reset(void);

#endif
