/* Interior point for a chain of stages; the statement and the method are in banded_qp.py.
 *
 * minimise   sum_k 1/2 x_k' H_k x_k + g_k' x_k + effort |x_k - x_(k-1)|^2 + rho sum_r s_r
 * subject to |x_k - x_(k-1)| <= step_k,   G_r x_k(r) + s_r >= h_r,   s_r >= 0
 *
 * Eliminating slacks and multipliers leaves a matrix of half bandwidth n: n(n+1) numbers a stage to
 * factor. Everything lives in the caller's workspace; nothing is allocated, nothing is global.
 */
#include <math.h>

#define DROPPED (-1e8) /* rows with a smaller right-hand side are not there */

typedef struct {
    int p, n, rows;
    const double *H, *g, *x0, *step, *G, *h;
    const int *kept, *first; /* kept rows by stage: kept[first[k]] .. kept[first[k + 1] - 1] */
} Data;

/* out = A z: limits above, limits below, rows. */
static void multiply(const Data *d, const double *z, double *out)
{
    const int n = d->n, N = d->p * n;
    for (int i = 0; i < N; i++) {
        const double move = z[i] - (i < n ? 0.0 : z[i - n]);
        out[i] = -move;
        out[N + i] = move;
    }
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
    for (int i = 0; i < N; i++) {
        out[i] = y[N + i] - y[i];
        if (i + n < N) out[i] -= y[N + i + n] - y[i + n];
    }
    for (int k = 0; k < d->p; k++)
        for (int r = d->first[k]; r < d->first[k + 1]; r++) {
            const double *row = d->G + (long)d->kept[r] * n;
            const double v = y[2 * N + r];
            double *o = out + k * n;
            for (int j = 0; j < n; j++) o[j] += v * row[j];
        }
}

/* Lower band by rows: band[i * (n + 1) + n - (i - j)] = M_ij for i - n <= j <= i. */
static void assemble(const Data *d, double effort, const double *w, double *band)
{
    const int n = d->n, N = d->p * n, width = n + 1;
    for (int k = 0; k < d->p; k++) {
        for (int i = 0; i < n; i++) {
            double *line = band + (long)(k * n + i) * width;
            for (int j = 0; j < width; j++) line[j] = 0.0;
            for (int j = 0; j <= i; j++) line[n - i + j] = d->H[((long)k * n + i) * n + j];
        }
        for (int r = d->first[k]; r < d->first[k + 1]; r++) {
            const double *row = d->G + (long)d->kept[r] * n;
            for (int i = 0; i < n; i++) {
                const double v = w[2 * N + r] * row[i];
                double *line = band + (long)(k * n + i) * width + n - i;
                for (int j = 0; j <= i; j++) line[j] += v * row[j];
            }
        }
    }
    for (int i = 0; i < N; i++) {
        const double v = w[i] + w[N + i] + 2.0 * effort;
        band[(long)i * width + n] += v;
        if (i >= n) {
            band[(long)i * width] -= v;
            band[(long)(i - n) * width + n] += v;
        }
    }
}

/* Cholesky in place, the diagonal inverted; 0 if the matrix is not positive. */
static int factor(double *band, int N, int n)
{
    const int width = n + 1;
    for (int i = 0; i < N; i++) {
        double *a = band + (long)i * width;
        const int from = i < n ? 0 : i - n;
        for (int j = from; j <= i; j++) {
            const double *b = band + (long)j * width;
            const int low = j < n ? 0 : j - n, start = low > from ? low : from;
            double sum = a[n - i + j];
            for (int l = start; l < j; l++) sum -= a[n - i + l] * b[n - j + l];
            if (j < i) {
                a[n - i + j] = sum * b[n];
            } else {
                if (!(sum > 0.0)) return 0;
                a[n] = 1.0 / sqrt(sum);
            }
        }
    }
    return 1;
}

static void substitute(const double *band, int N, int n, double *v)
{
    const int width = n + 1;
    for (int i = 0; i < N; i++) {
        const double *a = band + (long)i * width;
        double sum = v[i];
        for (int j = i < n ? 0 : i - n; j < i; j++) sum -= a[n - i + j] * v[j];
        v[i] = sum * a[n];
    }
    for (int i = N - 1; i >= 0; i--) {
        const double *a = band + (long)i * width;
        v[i] *= a[n];
        for (int j = i < n ? 0 : i - n; j < i; j++) v[j] -= a[n - i + j] * v[i];
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
    substitute(band, N, d->n, dz);
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
    return N * (n + 1) + 2 * N + 5 * M + 6 * K;
}

/* Returns the iterations, negative if it did not converge: see banded_qp.py for the arguments. */
int banded_qp(int p, int n, int rows, const double *H, const double *g, const double *x0,
              const double *step, const double *G, const double *h, double rho, double effort,
              double tolerance, int most, double *z, double *slack, double *multiplier, double *work, int *list)
{
    int *first = list, *kept = list + p + 1, count = 0;
    for (int k = 0; k < p; k++) {
        first[k] = count;
        for (int r = k * rows; r < (k + 1) * rows; r++) {
            slack[r] = multiplier[r] = 0.0;
            if (h[r] > DROPPED) kept[count++] = r;
        }
    }
    first[p] = count;
    const Data data = {p, n, count, H, g, x0, step, G, h, kept, first}, *d = &data;
    const int N = p * n, M = 2 * N + count, K = M + count;
    double *band = work, *dual = band + (long)N * (n + 1), *dz = dual + N, *az = dz + N,
           *adz = az + M, *w = adz + M, *q = w + M, *rp = q + M, *T = rp + M, *L = T + K,
           *dT = L + K, *dL = dT + K, *R = dL + K, *c = R + K;
    const double start = 1.0, room = 0.1;

    multiply(d, z, az);
    for (int i = 0; i < M; i++) {
        const int j = i < N ? i : i - N; /* move limits, then rows */
        const double begun = i < n ? x0[i] : (i >= N && i - N < n ? x0[i - N] : 0.0);
        const double b = i < N ? -(step[j] + begun)
                       : i < 2 * N ? -(step[j] - begun) : h[kept[i - 2 * N]];
        const double t = az[i] - b;
        az[i] = t; /* from here on az is A z - b */
        T[i] = t > room ? t : room;
        if (i >= 2 * N) T[M + i - 2 * N] = (t < 0.0 ? -t : 0.0) + room;
        L[i] = start / T[i];
    }
    for (int r = 0; r < count; r++) {
        if (L[2 * N + r] > 0.5 * rho) L[2 * N + r] = 0.5 * rho;
        L[M + r] = rho - L[2 * N + r];
    }
    for (int iteration = 0; iteration < most; iteration++) {
        double mu = 0.0, primal = 0.0, stationary = 0.0;
        multiply_transposed(d, L, dual);
        for (int k = 0; k < p; k++)
            for (int i = 0; i < n; i++) {
                const double *row = H + ((long)k * n + i) * n;
                double sum = g[k * n + i] - dual[k * n + i];
                for (int j = 0; j < n; j++) sum += row[j] * z[k * n + j];
                const int m = k * n + i;
                sum += 2.0 * effort * (z[m] - (m < n ? x0[m] : z[m - n]));
                if (m + n < N) sum -= 2.0 * effort * (z[m + n] - z[m]);
                dual[m] = sum;
                if (!(fabs(sum) <= stationary)) stationary = fabs(sum);
            }
        for (int i = 0; i < K; i++) mu += T[i] * L[i];
        mu /= K;
        for (int i = 0; i < M; i++) {
            rp[i] = az[i] - T[i] + (i >= 2 * N ? T[M + i - 2 * N] : 0.0);
            if (!(fabs(rp[i]) <= primal)) primal = fabs(rp[i]);
        }
        if (!(mu < 1e30) || !(primal < 1e30) || !(stationary < 1e30)) return -iteration - 1;
        if (mu < tolerance && primal < 1e-2 * tolerance && stationary < tolerance) {
            for (int r = 0; r < count; r++) {
                slack[kept[r]] = T[M + r];
                multiplier[kept[r]] = L[2 * N + r];
            }
            return iteration;
        }
        for (int i = 0; i < K; i++) R[i] = T[i] / L[i];
        for (int i = 0; i < M; i++) w[i] = 1.0 / (R[i] + (i >= 2 * N ? R[M + i - 2 * N] : 0.0));
        assemble(d, effort, w, band);
        if (!factor(band, N, n)) return -iteration - 1;
        double target = 0.0, length = 1.0;
        for (int corrected = 0; corrected < 2; corrected++) {
            for (int i = 0; i < K; i++)
                c[i] = (corrected ? (target - dT[i] * dL[i]) / L[i] : 0.0) - T[i];
            for (int i = 0; i < M; i++)
                q[i] = c[i] - rp[i] - (i >= 2 * N ? c[M + i - 2 * N] : 0.0);
            direction(d, band, w, q, dual, dz, adz, dL);
            for (int r = 0; r < count; r++) dL[M + r] = -dL[2 * N + r];
            for (int i = 0; i < K; i++) dT[i] = c[i] - R[i] * dL[i];
            length = longest(T, dT, K, 1.0);
            length = longest(L, dL, K, length);
            if (corrected) break;
            double ahead = 0.0;
            for (int i = 0; i < K; i++) ahead += (T[i] + length * dT[i]) * (L[i] + length * dL[i]);
            const double ratio = ahead / K / mu;
            target = ratio * ratio * ratio * mu;
        }
        if (length < 1.0) length *= 0.99;
        for (int i = 0; i < N; i++) z[i] += length * dz[i];
        for (int i = 0; i < M; i++) az[i] += length * adz[i];
        for (int i = 0; i < K; i++) { T[i] += length * dT[i]; L[i] += length * dL[i]; }
    }
    return -most - 1;
}
