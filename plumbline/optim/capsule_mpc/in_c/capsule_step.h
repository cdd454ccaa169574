/* One step of a controller for capsules that must not touch: lengths in m, times in s.
 *
 * Zero the state before the first step. A step takes the present state x, goals, and obstacles,
 * ${slots} capsules and then ${balls} spheres: both ends, radius, velocity; one that is not there is
 * a point at ${far}. It returns 0, and the rate of every state; or another number if there is no
 * plan: then the rate is zero, and the caller has to see to a stop. Nothing is allocated, and
 * nothing is global.
 *
 * The plan is here, and what is believed of obstacles that move otherwise than stated (Looks): an
 * obstacle keeps its row from step to step. Not here, and the caller's to see to:
 * - the net that tries a rate and the stop after it, limits of acceleration and jerk (Net, Stop);
 * - obstacles that turn back (Sweeps), or come faster than a tip (Evasion);
 * - more obstacles than rows (Seating);
 * - delay, lag, gain and dead band of what carries rates out, told or not (Plant, Underway);
 * - measurements, goals and obstacles that are no numbers.
 */
#ifndef CAPSULE_STEP_H
#define CAPSULE_STEP_H

#define STATES ${n}
#define STAGES ${p}
#define ROWS ${rows}
#define GOALS ${goals}
#define OBSTACLES ${obstacles}
#define NUMBERS ${numbers}
#define INPUTS (GOALS + NUMBERS * OBSTACLES + STATES)
#define STEP ${dt} /* [s] */
#define LOOKS ${looks} /* at an obstacle, that say how it moves */

typedef struct {
    int begun; /* whether path and move are known */
    int looks; /* that there were at the obstacles */
    double last[6 * OBSTACLES + 1], gone[4 * LOOKS * OBSTACLES + 1]; /* see believe() */
    double path[STAGES * STATES], move[STATES];
    double x[STATES], inputs[INPUTS], H[STAGES * STATES * STATES], g[STAGES * STATES];
    double G[STAGES * ROWS * STATES], h[STAGES * ROWS], steps[STAGES * STATES];
    double turn[STAGES * STATES * STATES];
    double slack[STAGES * ROWS], multiplier[STAGES * ROWS];
    double work[${work}], w[${sz_w}];
    long long int iw[${sz_iw}];
    const double *arg[${sz_arg}];
    double *res[${sz_res}];
    int kept[STAGES + 1 + STAGES * ROWS];
} capsule_state;

int capsule_step(capsule_state *s, const double *x, const double *goals, const double *obstacles,
                 double *rate);

#endif
