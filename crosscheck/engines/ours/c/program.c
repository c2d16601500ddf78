/* The march of one sample over the compiled program: `program.h`, which is generated, has its segments as functions.

   program.h defines NU, NW, NM (registers per bank), CORE, and
     inputs(u, g)            the geometry into u, and what is constant
     laws(w, f0, f1, f2)     the driver's law and its rates into w
     mechanism(u), times(u, w, m), newton(u, w, m), answer(u, w, m)
     core_in(w, q), core_out(w, q, v, a), levels_out(w, out)
     MARCHED                 1 if the program has rates, by which poses are predicted, else 0
     step_of(w), sign_of(w)  the last correction; the product of the determinants' signs */

#include "program.h"

static double u[NU + 1];

#if MARCHED
static double speed, level[LEVELS];

static int solve(double t, double *q, double *v, double *a, double *sign);

#define JERK 1
#include "march.h"

static int solve(double t, double *q, double *v, double *a, double *sign)
{
    double w[NW + 1], first = 0.0;
    int m[NM + 1], done = 0;
    laws(w, speed * t, speed, 0.0);
    times(u, w, m);
    core_in(w, q);
    for (int it = 0; it < MOST_NEWTON && !done; it++) {
        newton(u, w, m);
        double size = step_of(w);
        if (it == 1 && first > SMALL && !(size <= CONTRACTION * first))
            return 0;
        first = it ? first : size;
        done = size <= ENOUGH;
    }
    if (!done)
        return 0;
    answer(u, w, m);
    core_out(w, q, v, a);
    levels_out(w, level);
    *sign = sign_of(w);
    return 1;
}

/* As dense_march; geometry: `numbers` per mechanism in place of lengths; start: CORE per mechanism. */
long program_march(long mechanisms, long count, long numbers, const double *geometry, const double *start,
                const double *t, double rate, int keep, double *out)
{
    long good = 0;
    speed = rate;
    for (long k = 0; k < mechanisms; k++) {
        struct pose pose;
        inputs(u, geometry + numbers * k);
        mechanism(u);
        memcpy(pose.q, start + CORE * k, sizeof pose.q);
        pose.t = t[0];
        pose.h = 0.0;
        int ok = solve(t[0], pose.q, pose.v, pose.a, &pose.sign);
        double *to = out + (keep ? LEVELS * count * k : 0);
        for (long i = 0; i < count; i++, to += LEVELS) {
            if (i && ok)
                ok = advance(&pose, t[i]);
            good += ok;
            if (ok)
                memcpy(to, level, sizeof level);
            else
                for (int j = 0; j < LEVELS; j++)
                    to[j] = NAN;
        }
    }
    return good;
}

#else

/* So many corrections of one pose, one after another, and then its levels: for mechanisms of any size. */
double program_newton(long corrections, const double *geometry, const double *start, double f0, double f1, double f2,
                   double *out)
{
    static double w[NW + 1];
    static int m[NM + 1];
    inputs(u, geometry);
    mechanism(u);
    laws(w, f0, f1, f2);
    times(u, w, m);
    core_in(w, start);
    for (long k = 0; k < corrections; k++)
        newton(u, w, m);
    if (out) {
        answer(u, w, m);
        levels_out(w, out);
    }
    return step_of(w);
}

#endif
