#pragma once
#define PROGMEM
#define PSTR(text) text
