#pragma once
#define ISR(name) void name(void)
#define sei()
#define cli()
