/* The examples of the pages under another maker's compiler. C for matiec, C++ for STruC++. `examples.inc` names them, POUS.c or out.cpp
 * is written by the compiler. Each runs for one scan: a line has its name, and the number of its first claim that does not hold, else 0.
 * The program MyLoop of docs/plc.md then runs for 12 000 scans, compensated from 6001 on: a line for each 600th has its outputs. */

#include <stdio.h>
#include <stdlib.h>
#ifdef __cplusplus
#include "out.cpp"
using namespace strucpp;
#define MAKE(name) auto *o = new Program_##name()
#define SCAN(name) o->run()
#define AT(pin) (*o->pin.raw_ptr())
#else
#include "iec_std_lib.h"
#include "accessor.h"
#include "POUS.h"
#include "POUS.c"
#define MAKE(name) name *o = (name *)calloc(1, sizeof(name)); name##_init__(o, 0)
#define SCAN(name) name##_body__(o)
#define AT(pin) (o->pin.value)
#endif

#define RUN(name) { MAKE(name); SCAN(name); printf("%s,%d\n", #name, (int)AT(WRONG)); }

int main(void) {
#include "examples.inc"
    MAKE(MYLOOP);
    for (int scan = 1; scan <= 12000; scan++) {
        if (scan == 6001) AT(COMPENSATE) = 1;
        SCAN(MYLOOP);
        if (scan % 600) continue;
        printf("%d,%.7g,%.7g,%.7g,%.7g,%.7g,", scan, (double)AT(OP), (double)AT(PV), (double)AT(WIDTH), (double)AT(UFF), (double)AT(UFB));
        printf("%d,%d\n", (int)AT(STANDING), (int)AT(ERRORID));
    }
    return 0;
}
