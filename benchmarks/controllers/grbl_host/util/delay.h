#pragma once
#define _delay_ms(value)
#define _delay_us(value)
