/* Newton's method for revolutes and one driven angle, of any number, dense, with LU: n^3 / 3 multiplications. */

#include <math.h>
#include <string.h>

/* x := a^-1 x; a (n, n) is overwritten. 0 if a pivot is 0. */
static int solved(long n, double *a, double *x)
{
    for (long k = 0; k < n; k++) {
        long p = k;
        for (long i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[p * n + k]))
                p = i;
        if (a[p * n + k] == 0.0)
            return 0;
        if (p != k) {
            double y = x[k];
            x[k] = x[p];
            x[p] = y;
            for (long j = k; j < n; j++) {
                y = a[k * n + j];
                a[k * n + j] = a[p * n + j];
                a[p * n + j] = y;
            }
        }
        double r = 1.0 / a[k * n + k];
        for (long i = k + 1; i < n; i++) {
            double m = a[i * n + k] * r;
            if (m == 0.0)
                continue; /* most entries are 0, and stay so: even dense code looks at that */
            for (long j = k + 1; j < n; j++)
                a[i * n + j] -= m * a[k * n + j];
            x[i] -= m * x[k];
        }
    }
    for (long i = n - 1; i >= 0; i--) {
        for (long j = i + 1; j < n; j++)
            x[i] -= a[i * n + j] * x[j];
        x[i] /= a[i * n + i];
    }
    return 1;
}

/* So many corrections of q (n). A joint holds bodies ends[2 k] and ends[2 k + 1], -1 for the ground, together at points
   points[4 k ...]; the angle of body 0 is `angle`. matrix (n, n) and right (n) are room. Returns the last correction. */
double chain_newton(long corrections, long n, long joints, const long *ends, const double *points, double angle,
                    double *q, double *matrix, double *right)
{
    double size = NAN;
    for (long it = 0; it < corrections; it++) {
        memset(matrix, 0, sizeof(double) * n * n);
        for (long k = 0; k < joints; k++) {
            right[2 * k] = right[2 * k + 1] = 0.0;
            for (int side = 0; side < 2; side++) {
                long body = ends[2 * k + side];
                double sign = side ? 1.0 : -1.0, x = points[4 * k + 2 * side], y = points[4 * k + 2 * side + 1];
                if (body < 0) {
                    right[2 * k] += sign * x;
                    right[2 * k + 1] += sign * y;
                    continue;
                }
                double *row = matrix + 2 * k * n + 3 * body, c = cos(q[3 * body + 2]), s = sin(q[3 * body + 2]);
                double dx = c * x - s * y, dy = s * x + c * y;
                right[2 * k] += sign * (q[3 * body] + dx);
                right[2 * k + 1] += sign * (q[3 * body + 1] + dy);
                row[0] = row[n + 1] = sign;
                row[2] = -sign * dy;
                row[n + 2] = sign * dx;
            }
        }
        right[n - 1] = q[2] - angle;
        matrix[(n - 1) * n + 2] = 1.0;
        if (!solved(n, matrix, right))
            return NAN;
        size = 0.0;
        for (long k = 0; k < n; k++) {
            q[k] -= right[k];
            if (fabs(right[k]) > size)
                size = fabs(right[k]);
        }
    }
    return size;
}
