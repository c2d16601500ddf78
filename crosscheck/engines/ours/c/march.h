/* A march over the times of one mechanism, the same for every C kernel that solves by Newton.

   The next pose is predicted from the last by its velocity and acceleration and, if `JERK` is 1, by how the
   accelerations changed in the last step. A step is taken if Newton converges, contracts, and the determinant keeps its
   sign; otherwise it is halved. The kernel that includes this file defines before it

     CORE, JERK                            how many coordinates are predicted and iterated in; 0 or 1
     static int solve(double t, double *q, double *v, double *a, double *sign)
                                           from a guess q[CORE] to the answer; 0 if Newton does not contract */

#include <math.h>
#include <string.h>

#define ENOUGH 1e-8      /* Newton's error is squared by the next correction: that is the last one */
#define MOST_NEWTON 8
#define CONTRACTION 0.125
#define SMALL 1e-6       /* a first correction below this need not contract */
#define MOST_HALVINGS 30

struct pose {
    double t, h, sign, q[CORE], v[CORE], a[CORE], before[CORE];
};

static int step(const struct pose *last, double t, struct pose *next)
{
    double h = t - last->t;
    for (int k = 0; k < CORE; k++) {
        double jerk = JERK && last->h > 0.0 ? (last->a[k] - last->before[k]) / last->h : 0.0;
        next->q[k] = last->q[k] + h * (last->v[k] + h * (0.5 * last->a[k] + h / 6.0 * jerk));
        next->before[k] = last->a[k];
    }
    next->t = t;
    next->h = h;
    return solve(t, next->q, next->v, next->a, &next->sign) && next->sign * last->sign > 0.0;
}

/* Go on to t in as many steps as it takes; 0 if no step is short enough. */
static int advance(struct pose *pose, double t)
{
    struct pose next;
    double h = t - pose->t, smallest = ldexp(h, -MOST_HALVINGS);
    while (pose->t < t) {
        double to = pose->t + h >= t ? t : pose->t + h;
        if (step(pose, to, &next)) {
            *pose = next;
            h *= 2.0;
        } else {
            h = 0.5 * (to - pose->t);
            if (h < smallest)
                return 0;
        }
    }
    return 1;
}
