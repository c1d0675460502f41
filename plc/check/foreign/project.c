/* Runs the project for OpenPLC and Beremiz as their runtime does: 10 000 ticks of its task. Prints Done, Passed and Exact of its
 * GlappSelfTest, Found and Width of its GlappDemo, and Message of its GlappLoop, which nothing is connected to. */

#include <stdio.h>
#include "iec_std_lib.h"
#include "accessor.h"
#include "POUS.h"

TIME __CURRENT_TIME;
BOOL __DEBUG;
extern unsigned long long common_ticktime__;
extern GLAPPSELFTEST GLAPPRESOURCE__GLAPPRUN1;
extern GLAPPDEMO GLAPPRESOURCE__GLAPPRUN2;
extern GLAPPLOOP GLAPPRESOURCE__GLAPPRUN3;
void config_init__(void);
void config_run__(unsigned long tick);

int main(void) {
    config_init__();
    for (unsigned long tick = 0; tick < 10000; tick++) {
        unsigned long long now = tick * common_ticktime__;
        __CURRENT_TIME.tv_sec = (long)(now / 1000000000ull);
        __CURRENT_TIME.tv_nsec = (long)(now % 1000000000ull);
        config_run__(tick);
    }
    const GLAPPSELFTEST *test = &GLAPPRESOURCE__GLAPPRUN1;
    const GLAPPDEMO *demo = &GLAPPRESOURCE__GLAPPRUN2;
    printf("%d\t%d\t%d\t%d\t%.4f\t%d\n", test->DONE.value, test->PASSED.value, test->EXACT.value, demo->FOUND.value,
        (double)demo->WIDTH.value, GLAPPRESOURCE__GLAPPRUN3.MESSAGE.value);
    return 0;
}
