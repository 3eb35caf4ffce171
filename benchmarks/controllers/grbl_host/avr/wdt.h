#pragma once
#define wdt_enable(value)
