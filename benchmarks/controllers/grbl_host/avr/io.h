/* The registers that GRBL's stepper code writes, as plain numbers: nothing is connected to them. */
#pragma once
#include <stdint.h>

#define F_CPU 16000000UL

typedef struct {
  volatile uint8_t ports[12], timers[16];
  volatile uint16_t compare;
} registers;
extern registers host;

#define DDRB host.ports[0]
#define DDRC host.ports[1]
#define DDRD host.ports[2]
#define PORTB host.ports[3]
#define PORTC host.ports[4]
#define PORTD host.ports[5]
#define PINB host.ports[6]
#define PINC host.ports[7]
#define PIND host.ports[8]
#define TCCR0A host.timers[0]
#define TCCR0B host.timers[1]
#define TCCR1A host.timers[2]
#define TCCR1B host.timers[3]
#define TCNT0 host.timers[4]
#define TIMSK0 host.timers[5]
#define TIMSK1 host.timers[6]
#define OCR0A host.timers[7]
#define OCR1A host.compare
enum { CS00, CS01, CS02 };
enum { CS10, CS11, CS12, WGM12, WGM13 };
enum { WGM10, WGM11 };
enum { COM1B0 = 4, COM1B1, COM1A0, COM1A1 };
enum { TOIE0, OCIE0A, OCIE0B };
enum { TOIE1, OCIE1A, OCIE1B };
