/* A four-bar by Newton's method on its nine equations in x, y, phi of crank, coupler, rocker, dense, with LU.

   Rows: A0 (2), A (2), B (2), B0 (2), driver. What a person would write in C; nothing of the structure is used. */

#include <math.h>
#include <string.h>

#define N 9
#define CORE N

static double length[4]; /* ground, crank, coupler, rocker */
static double speed;

static int factor(double a[N][N], int order[N], double *sign)
{
    *sign = 1.0;
    for (int k = 0; k < N; k++) {
        int p = k;
        for (int i = k + 1; i < N; i++)
            if (fabs(a[i][k]) > fabs(a[p][k]))
                p = i;
        order[k] = p;
        if (a[p][k] == 0.0)
            return 0;
        if (p != k) {
            *sign = -*sign;
            for (int j = 0; j < N; j++) {
                double x = a[k][j];
                a[k][j] = a[p][j];
                a[p][j] = x;
            }
        }
        if (a[k][k] < 0.0)
            *sign = -*sign;
        double r = 1.0 / a[k][k];
        for (int i = k + 1; i < N; i++) {
            double m = a[i][k] * r;
            a[i][k] = m;
            for (int j = k + 1; j < N; j++)
                a[i][j] -= m * a[k][j];
        }
    }
    return 1;
}

static void substitute(const double a[N][N], const int order[N], double *x)
{
    for (int k = 0; k < N; k++) {
        double y = x[order[k]];
        x[order[k]] = x[k];
        x[k] = y;
    }
    for (int i = 1; i < N; i++)
        for (int j = 0; j < i; j++)
            x[i] -= a[i][j] * x[j];
    for (int i = N - 1; i >= 0; i--) {
        for (int j = i + 1; j < N; j++)
            x[i] -= a[i][j] * x[j];
        x[i] /= a[i][i];
    }
}

/* Vectors from the middles of the links to their pins: half the length, both ways. */
static void arms(const double *q, double arm[3][2])
{
    for (int k = 0; k < 3; k++) {
        double half = 0.5 * length[k + 1], phi = q[3 * k + 2];
        arm[k][0] = half * cos(phi);
        arm[k][1] = half * sin(phi);
    }
}

static void residual(const double *q, double arm[3][2], double t, double *phi)
{
    for (int c = 0; c < 2; c++) {
        phi[c] = q[c] - arm[0][c];
        phi[2 + c] = q[3 + c] - arm[1][c] - q[c] - arm[0][c];
        phi[4 + c] = q[6 + c] + arm[2][c] - q[3 + c] - arm[1][c];
        phi[6 + c] = q[6 + c] - arm[2][c] - (c ? 0.0 : length[0]);
    }
    phi[8] = q[2] - speed * t;
}

static void jacobian(double arm[3][2], double a[N][N])
{
    memset(a, 0, sizeof(double[N][N]));
    for (int c = 0; c < 2; c++) {
        double d[3]; /* derivatives of the arms by their angles */
        for (int k = 0; k < 3; k++)
            d[k] = c ? arm[k][0] : -arm[k][1];
        a[c][c] = 1.0;
        a[c][2] = -d[0];
        a[2 + c][3 + c] = 1.0;
        a[2 + c][5] = -d[1];
        a[2 + c][c] = -1.0;
        a[2 + c][2] = -d[0];
        a[4 + c][6 + c] = 1.0;
        a[4 + c][8] = d[2];
        a[4 + c][3 + c] = -1.0;
        a[4 + c][5] = -d[1];
        a[6 + c][6 + c] = 1.0;
        a[6 + c][8] = -d[2];
    }
    a[8][2] = 1.0;
}

static void bend(const double *v, double arm[3][2], double *gamma)
{
    double w[3] = {v[2] * v[2], v[5] * v[5], v[8] * v[8]};
    for (int c = 0; c < 2; c++) {
        gamma[c] = -w[0] * arm[0][c];
        gamma[2 + c] = -w[1] * arm[1][c] - w[0] * arm[0][c];
        gamma[4 + c] = w[2] * arm[2][c] - w[1] * arm[1][c];
        gamma[6 + c] = -w[2] * arm[2][c];
    }
    gamma[8] = 0.0;
}

static double largest(const double *x)
{
    double found = 0.0;
    for (int k = 0; k < N; k++)
        if (!(fabs(x[k]) <= found))
            found = fabs(x[k]);
    return found;
}

static double closed; /* the largest residual that is taken for 0 */

static int solve(double t, double *q, double *v, double *a, double *sign);

#define JERK 0
#include "march.h"

static int solve(double t, double *q, double *v, double *a, double *sign)
{
    double matrix[N][N], arm[3][2], x[N], first = 0.0;
    int order[N], done = 0;
    for (int it = 0; it < MOST_NEWTON && !done; it++) {
        arms(q, arm);
        residual(q, arm, t, x);
        jacobian(arm, matrix);
        if (!factor(matrix, order, sign))
            return 0;
        substitute(matrix, order, x);
        for (int k = 0; k < N; k++)
            q[k] -= x[k];
        double size = largest(x);
        if (it == 1 && first > SMALL && !(size <= CONTRACTION * first))
            return 0;
        first = it ? first : size;
        done = size <= ENOUGH;
    }
    arms(q, arm);
    residual(q, arm, t, x);
    if (!done || !(largest(x) <= closed))
        return 0;
    jacobian(arm, matrix);
    if (!factor(matrix, order, sign))
        return 0;
    memset(v, 0, N * sizeof *v);
    v[8] = speed;
    substitute(matrix, order, v);
    bend(v, arm, a);
    substitute(matrix, order, a);
    return 1;
}

/* All mechanisms over all times. lengths: 4 per mechanism; start: 9 per mechanism; out: 27 per time and, if `keep`, per
   mechanism, NaN where there is no answer. Returns how many configurations have one. */
long dense_march(long mechanisms, long times, const double *lengths, const double *start, const double *t, double rate,
                 int keep, double *out)
{
    long good = 0;
    speed = rate;
    for (long m = 0; m < mechanisms; m++) {
        struct pose pose;
        memcpy(length, lengths + 4 * m, sizeof length);
        memcpy(pose.q, start + 9 * m, sizeof pose.q);
        closed = 1e-14 * (length[0] + length[1] + length[2] + length[3]) + 1e-15 * fabs(speed * t[times - 1]);
        pose.t = t[0];
        pose.h = 0.0;
        int ok = solve(t[0], pose.q, pose.v, pose.a, &pose.sign);
        double *to = out + (keep ? 27 * times * m : 0);
        for (long k = 0; k < times; k++, to += 27) {
            if (k && ok)
                ok = advance(&pose, t[k]);
            good += ok;
            if (ok) {
                memcpy(to, pose.q, sizeof pose.q);
                memcpy(to + 9, pose.v, sizeof pose.v);
                memcpy(to + 18, pose.a, sizeof pose.a);
            } else
                for (int i = 0; i < 27; i++)
                    to[i] = NAN;
        }
    }
    return good;
}
