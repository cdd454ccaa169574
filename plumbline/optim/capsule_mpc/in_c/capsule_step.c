#include "capsule_step.h"
#include <math.h>

int program(const double **arg, double **res, long long int *iw, double *w, int mem);
int banded_qp_turned(int p, int n, int rows, const double *H, const double *g, const double *x0,
                     const double *move, const double *step, const double *G, const double *h,
                     double rho, double effort, double smooth, double tolerance, int most,
                     double *z, double *slack, double *multiplier, double *work, int *list,
                     const double *turn, const int *group);

static const double unit[STATES] = {${unit}}; /* [m] or [rad] of one of each state's */
static const int group[2 * STATES] = {${group}}; /* begin, then end of every state's group */

/* Velocities as places have gone, where stated otherwise. Of every obstacle: its middle and
   half a step by its velocity; of each of the last steps, what it is beside that, and its length. */
static void believe(capsule_state *s, double *o)
{
    const int slot = s->looks % LOOKS, count = s->looks < LOOKS ? s->looks : LOOKS;
    for (int k = 0; k < OBSTACLES; k++, o += NUMBERS) {
        double *last = s->last + 6 * k, *gone = s->gone + 4 * LOOKS * k, *own = gone + 4 * slot;
        double off = 0.0, way = 0.0, sum[4] = {0.0};
        for (int i = 0; i < 3; i++) {
            const double middle = (o[i] + o[3 + i]) / 2, half = STEP / 2 * o[7 + i];
            own[i] = count ? middle - last[i] - last[3 + i] - half : 0.0;
            off += own[i] * own[i];
            way += count ? (middle - last[i]) * (middle - last[i]) : 0.0;
            last[i] = middle;
            last[3 + i] = half;
        }
        own[3] = sqrt(way);
        for (int j = 0; j < 4 * LOOKS; j++) {
            if (!(off < ${fastest})) gone[j] = 0.0; /* another obstacle */
            sum[j % 4] += gone[j];
        }
        const double most = fmax(${straight}, ${changed} * sum[3]);
        if (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2] > most * most)
            for (int i = 0; i < 3; i++) o[7 + i] += sum[i] / (count * STEP);
    }
    s->looks += s->looks + 1 < 2 * LOOKS ? 1 : 1 - LOOKS;
}

static void gather(capsule_state *s, const double *x, const double *goals, const double *obstacles)
{
    double *to = s->inputs;
    for (int i = 0; i < STATES; i++) s->x[i] = x[i] / unit[i];
    for (int i = 0; i < GOALS; i++) *to++ = ${mm} * goals[i];
    for (int i = 0; i < NUMBERS * OBSTACLES; i++) to[i] = ${mm} * obstacles[i];
    believe(s, to);
    to += NUMBERS * OBSTACLES;
    for (int i = 0; i < STATES; i++) {
        if (!s->begun) s->move[i] = 0.0;
        *to++ = s->move[i];
    }
    for (int i = 0; i < STAGES * STATES; i++)
        if (!s->begun) s->path[i] = s->x[i % STATES];
}

static int linearise(capsule_state *s)
{
    s->arg[0] = s->inputs; s->arg[1] = s->x; s->arg[2] = s->path;
    s->res[0] = s->H; s->res[1] = s->g; s->res[2] = s->G; s->res[3] = s->h; s->res[4] = s->steps;
    s->res[5] = s->turn;
    return program(s->arg, s->res, s->iw, s->w, 0);
}

int capsule_step(capsule_state *s, const double *x, const double *goals, const double *obstacles,
                 double *rate)
{
    int usable = 1;
    gather(s, x, goals, obstacles);
    const int failed = linearise(s);
    const int count = failed ? -1 : banded_qp_turned(
        STAGES, STATES, ROWS, s->H, s->g, s->x, s->move, s->steps, s->G, s->h, ${penalty},
        ${effort}, ${smooth}, ${tolerance}, ${most}, s->path, s->slack, s->multiplier, s->work,
        s->kept, ${turn}, group);
    for (int i = 0; i < STAGES * STATES; i++) usable = usable && isfinite(s->path[i]);
    s->begun = count >= 0 && usable;
    for (int i = 0; i < STATES; i++) {
        const int begin = group[i], end = group[STATES + i];
        double length = 0.0;
        for (int j = begin; j < end; j++) length += (s->path[j] - s->x[j]) * (s->path[j] - s->x[j]);
        length = fmax(sqrt(length), ${touching}); /* the box about the ball has corners */
        s->move[i] = s->begun ? (s->path[i] - s->x[i]) * fmin(1.0, s->steps[begin] / length) : 0.0;
        rate[i] = s->move[i] * unit[i] / STEP;
    }
    for (int i = 0; i < (STAGES - 1) * STATES; i++) s->path[i] = s->path[i + STATES];
    return s->begun ? 0 : 1;
}
