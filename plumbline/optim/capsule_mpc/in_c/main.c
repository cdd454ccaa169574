/* Drives the exact model; prints the rates of every step, and the path where the next begins. */
#include "capsule_step.h"
#include <stdio.h>

static const double start[] = {${start}};
static const double goals[] = {${goal}};
static double obstacles[] = {${seen}};
static capsule_state state;

int main(void)
{
    double x[STATES], rate[STATES];
    for (int i = 0; i < STATES; i++) x[i] = start[i];
    for (int k = 0; k < ${steps}; k++) {
        if (capsule_step(&state, x, goals, obstacles, rate)) return 1;
        for (int i = 0; i < STATES; i++) {
            printf("%.17g ", rate[i]);
            x[i] += STEP * rate[i];
        }
        for (int i = 0; i < STAGES * STATES; i++)
            printf("%.17g%c", state.path[i], i + 1 < STAGES * STATES ? ' ' : '\n');
        for (int i = 0; i < NUMBERS * OBSTACLES; i++) /* ends move by the velocity */
            if (i % NUMBERS < 6)
                obstacles[i] += STEP * obstacles[i - i % NUMBERS + 7 + i % NUMBERS % 3];
    }
    return 0;
}
