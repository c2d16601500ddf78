/* A four-bar by trigonometry: two circles meet; the loop equation is differentiated twice (see closed_form.py). */

#include <math.h>

static void link(double half, const double *e, const double *foot, const double *v, const double *a, double phi,
                 double w, double bend, double *q, double *qd, double *qdd)
{
    double along = half * w * w;
    q[0] = foot[0] + half * e[0];
    q[1] = foot[1] + half * e[1];
    q[2] = phi;
    qd[0] = v[0] - half * w * e[1];
    qd[1] = v[1] + half * w * e[0];
    qd[2] = w;
    qdd[0] = a[0] - half * bend * e[1] - along * e[0];
    qdd[1] = a[1] + half * bend * e[0] - along * e[1];
    qdd[2] = bend;
}

/* As dense_march, OPEN, and without a start. */
long closed_form(long mechanisms, long times, const double *lengths, const double *start, const double *t, double rate,
                 int keep, double *out)
{
    (void)start;
    const double zero[2] = {0.0, 0.0};
    for (long m = 0; m < mechanisms; m++, lengths += 4) {
        double g = lengths[0], a = lengths[1], b = lengths[2], c = lengths[3], pull = a * rate * rate;
        double pivot[2] = {g, 0.0}, *to = out + (keep ? 27 * times * m : 0);
        for (long k = 0; k < times; k++, to += 27) {
            double phi = rate * t[k], u[2] = {cos(phi), sin(phi)}, tip[2] = {a * u[0], a * u[1]};
            double dx = g - tip[0], dy = -tip[1], square = dx * dx + dy * dy;
            double along = ((b - c) * (b + c) + square) / (2.0 * square);
            double rest = b * b / square - along * along, across = rest > 0.0 ? sqrt(rest) : 0.0;
            double p[2] = {(along * dx - across * dy) / b, (along * dy + across * dx) / b};
            double r[2] = {(tip[0] + b * p[0] - g) / c, (tip[1] + b * p[1]) / c};
            double cross = r[0] * p[1] - r[1] * p[0], bend = r[0] * p[0] + r[1] * p[1];
            double ru = r[0] * u[1] - r[1] * u[0], pu = p[0] * u[1] - p[1] * u[0];
            double wb = -a * rate * ru / (b * cross), wc = -a * rate * pu / (c * cross);
            double cc = c * wc * wc, bb = b * wb * wb;
            double ab = (cc - pull * (r[0] * u[0] + r[1] * u[1]) - bb * bend) / (b * cross);
            double ac = (cc * bend - pull * (p[0] * u[0] + p[1] * u[1]) - bb) / (c * cross);
            double v[2] = {-a * rate * u[1], a * rate * u[0]}, acc[2] = {-pull * u[0], -pull * u[1]};
            link(0.5 * a, u, zero, zero, zero, phi, rate, 0.0, to, to + 9, to + 18);
            link(0.5 * b, p, tip, v, acc, atan2(p[1], p[0]), wb, ab, to + 3, to + 12, to + 21);
            link(0.5 * c, r, pivot, zero, zero, atan2(r[1], r[0]), wc, ac, to + 6, to + 15, to + 24);
        }
    }
    return mechanisms * times;
}
