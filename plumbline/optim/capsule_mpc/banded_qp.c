/* Interior point for a chain of stages; the statement and the method are in banded_qp.py.
 *
 * minimise   sum_k 1/2 x_k' H_k x_k + g_k' x_k + effort |x_k - x_(k-1)|^2
 *            + smooth |x_k - 2 x_(k-1) + x_(k-2)|^2 + rho sum_r s_r
 * subject to |Q_k (x_k - x_(k-1))| <= step_k,   G_r x_k(r) + s_r >= h_r,   s_r >= 0
 *
 * Q_k turns the states of each group, and nothing where it is not given.
 * Eliminating slacks and multipliers leaves a matrix of half bandwidth b, n + s - 1 for groups of s, or 2n: n(b+1) numbers a
 * stage to factor. Everything lives in the caller's workspace; nothing is allocated, nothing is global.
 */
#include <math.h>

#define DROPPED (-1e8) /* rows with a smaller right-hand side are not there */
#define ROOM 0.1       /* [mm] that every slack has at the start */

typedef struct {
    int p, n, rows, b; /* b: half bandwidth */
    double effort, smooth;
    const double *H, *g, *x0, *move, *step, *G, *h, *turn; /* turn: Q, p n n, or 0 */
    const int *group;         /* begin, then end of every state's group: 2 n */
    const int *kept, *first; /* kept rows by stage: kept[first[k]] .. kept[first[k + 1] - 1] */
} Data;

/* Element i of Q_k v. */
static inline double turned_by(const Data *d, int k, int i, const double *v)
{
    if (!d->turn) return v[i];
    const double *q = d->turn + ((long)k * d->n + i) * d->n;
    double sum = 0.0;
    for (int j = d->group[i]; j < d->group[d->n + i]; j++) sum += q[j] * v[j];
    return sum;
}

/* out = A z: limits above, limits below, rows. */
static void multiply(const Data *d, const double *z, double *out)
{
    const int n = d->n, N = d->p * n;
    for (int i = 0; i < N; i++) out[i] = z[i] - (i < n ? 0.0 : z[i - n]);
    for (int k = 0; k < d->p; k++)
        for (int i = 0; i < n; i++) out[N + k * n + i] = turned_by(d, k, i, out + k * n);
    for (int i = 0; i < N; i++) out[i] = -out[N + i];
    for (int k = 0; k < d->p; k++)
        for (int r = d->first[k]; r < d->first[k + 1]; r++) {
            const double *row = d->G + (long)d->kept[r] * n, *x = z + k * n;
            double sum = 0.0;
            for (int j = 0; j < n; j++) sum += row[j] * x[j];
            out[2 * N + r] = sum;
        }
}

/* out = A' y. */
static void multiply_transposed(const Data *d, const double *y, double *out)
{
    const int n = d->n, N = d->p * n;
    for (int i = 0; i < N; i++) out[i] = d->turn ? 0.0 : y[N + i] - y[i];
    for (int m = 0; d->turn && m < N; m++) {
        const double force = y[N + m] - y[m], *q = d->turn + (long)m * n;
        const int i = m % n;
        for (int j = d->group[i]; j < d->group[n + i]; j++) out[m - i + j] += q[j] * force;
    }
    for (int i = 0; i + n < N; i++) out[i] -= out[i + n];
    for (int k = 0; k < d->p; k++)
        for (int r = d->first[k]; r < d->first[k + 1]; r++) {
            const double *row = d->G + (long)d->kept[r] * n;
            const double v = y[2 * N + r];
            double *o = out + k * n;
            for (int j = 0; j < n; j++) o[j] += v * row[j];
        }
}

/* The limits' share of the matrix, Q' w Q of every stage, where Q is given. */
static void assemble_turned(const Data *d, const double *w, double *band)
{
    const int n = d->n, N = d->p * n, width = d->b + 1;
    for (int k = 0; k < d->p; k++)
        for (int i = 0; i < n; i++)
            for (int j = d->group[i]; j < d->group[n + i]; j++) {
                double v = 0.0;
                for (int m = d->group[i]; m < d->group[n + i]; m++) {
                    const double *q = d->turn + ((long)k * n + m) * n;
                    v += q[i] * q[j] * (w[k * n + m] + w[N + k * n + m]);
                }
                double *own = band + (long)(k * n + j) * width, *before = own - (long)n * width;
                if (i >= j) own[i - j] += v;
                if (k && i >= j) before[i - j] += v;
                if (k) before[n + i - j] -= v;
            }
}

/* Lower band by columns: band[j * (b + 1) + i - j] = M_ij for j <= i <= j + b. */
static void assemble(const Data *d, const double *w, double *band)
{
    const int n = d->n, N = d->p * n, width = d->b + 1;
    const double smooth = 2.0 * d->smooth;
    for (long i = 0; i < (long)(N + d->b) * width; i++) band[i] = 0.0;
    for (int k = 0; k < d->p; k++) {
        for (int j = 0; j < n; j++) {
            double *column = band + (long)(k * n + j) * width - j;
            const double *from = d->H + ((long)k * n + j) * n; /* H is symmetric */
            for (int i = j; i < n; i++) column[i] = from[i];
        }
        for (int r = d->first[k]; r < d->first[k + 1]; r++) {
            const double *row = d->G + (long)d->kept[r] * n;
            for (int j = 0; j < n; j++) {
                const double v = w[2 * N + r] * row[j];
                double *column = band + (long)(k * n + j) * width - j;
                for (int i = j; i < n; i++) column[i] += v * row[i];
            }
        }
    }
    if (d->turn) assemble_turned(d, w, band);
    for (int i = 0; i < N; i++) {
        const double v = (d->turn ? 0.0 : w[i] + w[N + i]) + 2.0 * d->effort;
        double *here = band + (long)i * width, *one = here - (long)n * width;
        here[0] += v;
        if (i >= n) {
            one[n] -= v;
            one[0] += v;
        }
        if (smooth > 0.0) {
            here[0] += smooth * (1.0 + (i + n < N ? 4.0 : 0.0) + (i + 2 * n < N ? 1.0 : 0.0));
            if (i >= n) one[n] -= smooth * (i + n < N ? 4.0 : 2.0);
            if (i >= 2 * n) (one - (long)n * width)[2 * n] += smooth;
        }
    }
}

/* Cholesky in place, the diagonal inverted; 0 if the matrix is not positive. Behind the last column
 * there are b columns of zeros, so that all loops have one length. */
static inline int factor_by(double *band, int N, const int b)
{
    for (int i = 0; i < N; i++) {
        double *c = band + (long)i * (b + 1);
        if (!(c[0] > 0.0)) return 0;
        c[0] = 1.0 / sqrt(c[0]);
        for (int k = 1; k <= b; k++) c[k] *= c[0];
        for (int k = 1; k <= b; k++) {
            double *to = c + (long)k * b;
            for (int j = k; j <= b; j++) to[j] -= c[k] * c[j];
        }
    }
    return 1;
}

/* Behind the last number of v there are b more. */
static inline void substitute_by(const double *band, int N, const int b, double *v)
{
    for (int k = 0; k < b; k++) v[N + k] = 0.0;
    for (int i = 0; i < N; i++) {
        const double *c = band + (long)i * (b + 1);
        v[i] *= c[0];
        for (int k = 1; k <= b; k++) v[i + k] -= c[k] * v[i];
    }
    for (int i = N - 1; i >= 0; i--) {
        const double *c = band + (long)i * (b + 1);
        double sum = v[i];
        for (int k = 1; k <= b; k++) sum -= c[k] * v[i + k];
        v[i] = sum * c[0];
    }
}

/* The usual widths get code of their own, in which the compiler knows how long every loop is. */
static int factor(double *band, int N, int b)
{
    switch (b) {
    case 3: return factor_by(band, N, 3);
    case 6: return factor_by(band, N, 6);
    case 9: return factor_by(band, N, 9);
    case 12: return factor_by(band, N, 12);
    case 14: return factor_by(band, N, 14);
    case 18: return factor_by(band, N, 18);
    case 24: return factor_by(band, N, 24);
    case 28: return factor_by(band, N, 28);
    default: return factor_by(band, N, b);
    }
}

static void substitute(const double *band, int N, int b, double *v)
{
    switch (b) {
    case 6: substitute_by(band, N, 6, v); break;
    case 12: substitute_by(band, N, 12, v); break;
    case 18: substitute_by(band, N, 18, v); break;
    default: substitute_by(band, N, b, v);
    }
}

/* One Newton direction for given right-hand sides q of the eliminated equations. */
static void direction(const Data *d, const double *band, const double *w, const double *q,
                      const double *dual, double *dz, double *adz, double *y)
{
    const int N = d->p * d->n, M = 2 * N + d->rows;
    for (int i = 0; i < M; i++) y[i] = w[i] * q[i];
    multiply_transposed(d, y, dz);
    for (int i = 0; i < N; i++) dz[i] -= dual[i];
    substitute(band, N, d->b, dz);
    multiply(d, dz, adz);
    for (int i = 0; i < M; i++) y[i] = w[i] * (q[i] - adz[i]);
}

static double longest(const double *value, const double *change, int count, double most)
{
    for (int i = 0; i < count; i++)
        if (change[i] < 0.0 && -value[i] > most * change[i]) most = -value[i] / change[i];
    return most;
}

/* Doubles of workspace for p stages of n states and at most `rows` rows. */
long banded_qp_space(int p, int n, int rows)
{
    const long N = (long)p * n, M = 2 * N + rows, K = M + rows;
    return (N + 2 * n) * (2 * n + 1) + 2 * N + 2 * n + 5 * M + 6 * K;
}

/* Everything that changes between iterations; the caller's workspace, cut into pieces. */
typedef struct {
    double *band, *dual, *dz, *az, *adz, *w, *q, *rp, *T, *L, *dT, *dL, *R, *c;
} Work;

static Work cut(double *work, int b, int N, int M, int K)
{
    Work v;
    v.band = work; v.dual = v.band + (long)(N + b) * (b + 1); v.dz = v.dual + N; v.az = v.dz + N + b;
    v.adz = v.az + M; v.w = v.adz + M; v.q = v.w + M; v.rp = v.q + M;
    v.T = v.rp + M; v.L = v.T + K; v.dT = v.L + K; v.dL = v.dT + K; v.R = v.dL + K; v.c = v.R + K;
    return v;
}

/* Number the kept rows of every stage, and put all slacks and multipliers to zero. */
static int keep(int p, int rows, const double *h, int *first, int *kept, double *slack,
                double *multiplier)
{
    int count = 0;
    for (int k = 0; k < p; k++) {
        first[k] = count;
        for (int r = k * rows; r < (k + 1) * rows; r++) {
            slack[r] = multiplier[r] = 0.0;
            if (!(h[r] <= DROPPED)) kept[count++] = r; /* a NaN stays, and is refused below */
        }
    }
    first[p] = count;
    return count;
}

/* Slacks and multipliers to start with; from here on az is A z - b. */
static void begin(const Data *d, double rho, const double *z, const Work *v)
{
    const int n = d->n, N = d->p * n, M = 2 * N + d->rows;
    multiply(d, z, v->az);
    for (int i = 0; i < M; i++) {
        const int j = i < N ? i : i - N; /* move limits, then rows */
        const int f = i < N ? i : i - N;
        const double begun = f < n ? turned_by(d, 0, f, d->x0) : 0.0;
        const double b = i < N ? -(d->step[j] + begun)
                       : i < 2 * N ? -(d->step[j] - begun) : d->h[d->kept[i - 2 * N]];
        const double t = v->az[i] - b;
        v->az[i] = t;
        v->T[i] = t > ROOM ? t : ROOM;
        if (i >= 2 * N) v->T[M + i - 2 * N] = (t < 0.0 ? -t : 0.0) + ROOM;
        v->L[i] = 1.0 / v->T[i];
    }
    for (int r = 0; r < d->rows; r++) {
        if (v->L[2 * N + r] > 0.5 * rho) v->L[2 * N + r] = 0.5 * rho;
        v->L[M + r] = rho - v->L[2 * N + r];
    }
}

/* The step that ends in z_m; for numbers below 0 the one before x0. */
static double moved(const Data *d, const double *z, int m)
{
    if (m < 0) return d->move[m + d->n];
    return z[m] - (m < d->n ? d->x0[m] : z[m - d->n]);
}

/* How that step differs from the one before it; 0 beyond the end. */
static double turned(const Data *d, const double *z, int m)
{
    return m < d->p * d->n ? moved(d, z, m) - moved(d, z, m - d->n) : 0.0;
}

typedef struct {
    double mu, primal, stationary;
    int usable; /* 0 if any number is none, or beyond all bounds */
} Residual;

/* What is left of the conditions of optimality; fills dual and rp. */
static Residual residual(const Data *d, const double *z, const Work *v)
{
    const int n = d->n, N = d->p * n, M = 2 * N + d->rows, K = M + d->rows;
    Residual out = {0.0, 0.0, 0.0, 1};
    double none = 0.0; /* 0 times a number that is none is none, and stays so */
    multiply_transposed(d, v->L, v->dual);
    for (int k = 0; k < d->p; k++)
        for (int i = 0; i < n; i++) {
            const int m = k * n + i;
            const double *row = d->H + (long)m * n;
            double sum = d->g[m] - v->dual[m];
            for (int j = 0; j < n; j++) sum += row[j] * z[k * n + j];
            sum += 2.0 * d->effort * moved(d, z, m);
            if (m + n < N) sum -= 2.0 * d->effort * moved(d, z, m + n);
            if (d->smooth > 0.0)
                sum += 2.0 * d->smooth
                       * (turned(d, z, m) - 2.0 * turned(d, z, m + n) + turned(d, z, m + 2 * n));
            v->dual[m] = sum;
            none += 0.0 * sum;
            if (fabs(sum) > out.stationary) out.stationary = fabs(sum);
        }
    for (int i = 0; i < K; i++) out.mu += v->T[i] * v->L[i];
    out.mu /= K;
    for (int i = 0; i < M; i++) {
        v->rp[i] = v->az[i] - v->T[i] + (i >= 2 * N ? v->T[M + i - 2 * N] : 0.0);
        none += 0.0 * v->rp[i];
        if (fabs(v->rp[i]) > out.primal) out.primal = fabs(v->rp[i]);
    }
    out.usable = none == 0.0 && out.mu < 1e30 && out.primal < 1e30 && out.stationary < 1e30;
    return out;
}

/* Predictor and corrector on one factor; returns how far to go. */
static double improve(const Data *d, double mu, const Work *v)
{
    const int N = d->p * d->n, M = 2 * N + d->rows, K = M + d->rows;
    double target = 0.0, length = 1.0;
    for (int corrected = 0; corrected < 2; corrected++) {
        for (int i = 0; i < K; i++)
            v->c[i] = (corrected ? (target - v->dT[i] * v->dL[i]) / v->L[i] : 0.0) - v->T[i];
        for (int i = 0; i < M; i++)
            v->q[i] = v->c[i] - v->rp[i] - (i >= 2 * N ? v->c[M + i - 2 * N] : 0.0);
        direction(d, v->band, v->w, v->q, v->dual, v->dz, v->adz, v->dL);
        for (int r = 0; r < d->rows; r++) v->dL[M + r] = -v->dL[2 * N + r];
        for (int i = 0; i < K; i++) v->dT[i] = v->c[i] - v->R[i] * v->dL[i];
        length = longest(v->L, v->dL, K, longest(v->T, v->dT, K, 1.0));
        if (corrected) break;
        double ahead = 0.0;
        for (int i = 0; i < K; i++)
            ahead += (v->T[i] + length * v->dT[i]) * (v->L[i] + length * v->dL[i]);
        const double ratio = ahead / K / mu;
        /* Its cube, which centres less, goes round between two points for ever, once in a thousand. */
        target = ratio * ratio * mu;
    }
    return length < 1.0 ? 0.99 * length : length;
}

/* Returns the iterations, negative if it did not converge: see banded_qp.py for the arguments. */
int banded_qp_turned(int p, int n, int rows, const double *H, const double *g, const double *x0,
              const double *move, const double *step, const double *G, const double *h,
              double rho, double effort, double smooth, double tolerance, int most, double *z, double *slack, double *multiplier,
              double *work, int *list, const double *turn, const int *group)
{
    int *first = list, *kept = list + p + 1;
    const int count = keep(p, rows, h, first, kept, slack, multiplier);
    int widest = 1;
    for (int i = 0; turn && i < n; i++)
        if (group[n + i] - group[i] > widest) widest = group[n + i] - group[i];
    const int b = smooth > 0.0 ? 2 * n : n + widest - 1;
    const Data data = {p,  n,    count, b, effort, smooth, H, g,
                       x0, move, step,  G, h,      turn,   group, kept, first},
               *d = &data;
    const int N = p * n, M = 2 * N + count, K = M + count;
    const Work v = cut(work, b, N, M, K);

    begin(d, rho, z, &v);
    for (int iteration = 0; iteration < most; iteration++) {
        const Residual left = residual(d, z, &v);
        if (!left.usable) return -iteration - 1;
        if (left.mu < tolerance && left.primal < 1e-2 * tolerance && left.stationary < tolerance) {
            for (int r = 0; r < count; r++) {
                slack[kept[r]] = v.T[M + r];
                multiplier[kept[r]] = v.L[2 * N + r];
            }
            return iteration;
        }
        for (int i = 0; i < K; i++) v.R[i] = v.T[i] / v.L[i];
        for (int i = 0; i < M; i++)
            v.w[i] = 1.0 / (v.R[i] + (i >= 2 * N ? v.R[M + i - 2 * N] : 0.0));
        assemble(d, v.w, v.band);
        if (!factor(v.band, N, b)) return -iteration - 1;
        const double length = improve(d, left.mu, &v);
        for (int i = 0; i < N; i++) z[i] += length * v.dz[i];
        for (int i = 0; i < M; i++) v.az[i] += length * v.adz[i];
        for (int i = 0; i < K; i++) { v.T[i] += length * v.dT[i]; v.L[i] += length * v.dL[i]; }
    }
    return -most - 1;
}

/* The same with nothing turned. */
int banded_qp(int p, int n, int rows, const double *H, const double *g, const double *x0,
              const double *move, const double *step, const double *G, const double *h,
              double rho, double effort, double smooth, double tolerance, int most, double *z,
              double *slack, double *multiplier, double *work, int *list)
{
    return banded_qp_turned(p, n, rows, H, g, x0, move, step, G, h, rho, effort, smooth, tolerance,
                            most, z, slack, multiplier, work, list, 0, 0);
}
