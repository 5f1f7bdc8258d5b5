/* Loops over numbers and contacts, compiled where there is a compiler (loops.py).

   What each computes stands in Python beside its caller, with NumPy: integrator.py and network_state.py. Here it is
   one pass in place of dozens, with the same formulas. Sums that NumPy takes in another order round otherwise. */

#include <math.h>
#include <stddef.h>

typedef ptrdiff_t whole; /* intp of NumPy */
enum { LANES = 64 }; /* numbers that stay in the nearest cache together */

/* The widest vectors of the processor at hand; without fused products all of them give the same bits */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VECTORS __attribute__((target_clones("avx2", "default")))
#else
#define VECTORS
#endif

/* out = sum of weights[r] * table[r], for rows of n numbers that are `stride` apart; a weight of 0 takes no time. */
VECTORS void weighted(whole n, whole rows, const double *weights, const double *table, whole stride, double *out)
{
  for (whole from = 0; from < n; from += 8 * LANES) {
    const whole count = n - from < 8 * LANES ? n - from : 8 * LANES;
    double sum[8 * LANES] = {0};
    for (whole r = 0; r < rows; r++)
      if (weights[r] != 0)
        for (whole i = 0; i < count; i++) sum[i] += weights[r] * table[r * stride + from + i];
    for (whole i = 0; i < count; i++) out[from + i] = sum[i];
  }
}

/* squares[e] = sum over n numbers of (Σ_r weights[e][r] slopes[r] / (atol + rtol max(|begin|, |after|)))², e = 0, 1. */
VECTORS void errors(whole n, whole rows, const double *weights, const double *slopes, const double *begin,
                    const double *after, const double *atol, double rtol, double *squares)
{
  double total[2][LANES] = {{0}};
  for (whole from = 0; from < n; from += LANES) {
    const whole count = n - from < LANES ? n - from : LANES;
    double scale[LANES], sum[2][LANES] = {{0}};
    for (whole i = 0; i < count; i++) {
      const double a = fabs(begin[from + i]), b = fabs(after[from + i]);
      scale[i] = atol[from + i] + rtol * (a > b ? a : b);
    }
    for (whole r = 0; r < rows; r++) {
      const double one = weights[r], two = weights[rows + r], *slope = slopes + r * n + from;
      if (one != 0 || two != 0)
        for (whole i = 0; i < count; i++) {
          sum[0][i] += one * slope[i];
          sum[1][i] += two * slope[i];
        }
    }
    for (whole i = 0; i < count; i++) {
      const double one = sum[0][i] / scale[i], two = sum[1][i] / scale[i];
      total[0][i] += one * one;
      total[1][i] += two * two;
    }
  }
  squares[0] = squares[1] = 0;
  for (whole i = 0; i < LANES; i++) {
    squares[0] += total[0][i];
    squares[1] += total[1][i];
  }
}

/* Pairs of `network_state.Pairs` in the plane; those on walls, which are at rest, come after `free` others.

   Of numbers that are the same for all pairs, `same`, there are LANES. */
enum { X, Y, LENGTH, OVERLAP, FIRST_RADIUS, SECOND_RADIUS, HERTZ, SHEAR, ADHESION, NUMBERS };
typedef struct {
  whole spheres, pairs, free;
  double friction;
  const int *first, *second;
  const double *numbers[NUMBERS];
  whole same[NUMBERS];
} Pairs;

/* Forces and torques (3, N) of pairs with the secant law, without dashpots, and the rates of slips.

   motion: (6, N). slip, slip_rate: (M). sums: dW/dt of the ledger, the energies of normal and of shear forces, and how
   many contacts are open and have a slip, or are beyond the limit of friction, where the forces are others. */
VECTORS void plane(const Pairs *p, const double *motion, const double *slip, double *load, double *slip_rate,
                   double *sums)
{
  const whole N = p->spheres;
  const double mu = p->friction;
  const double *x = motion, *y = motion + N, *vx = motion + 3 * N, *vy = motion + 4 * N, *spin = motion + 5 * N;
  double work[LANES] = {0}, normal[LANES] = {0}, shear[LANES] = {0}, lost[LANES] = {0};
  for (whole i = 0; i < 3 * N; i++) load[i] = 0;
  for (whole from = 0, count; from < p->pairs; from += count) {
    const int wall = from >= p->free;
    const whole left = (wall ? p->pairs : p->free) - from;
    const int *first = p->first + from, *second = p->second + from;
    double dx[LANES], dy[LANES], rx[LANES], ry[LANES], here[LANES], there[LANES];
    double fx[LANES], fy[LANES], on_first[LANES], on_second[LANES];
    const double *number[NUMBERS];
    for (int k = 0; k < NUMBERS; k++) number[k] = p->numbers[k] + (p->same[k] ? 0 : from);
    const double *ax = number[X], *ay = number[Y], *length = number[LENGTH], *gap = number[OVERLAP];
    const double *R = number[FIRST_RADIUS], *Q = number[SECOND_RADIUS];
    const double *A = number[HERTZ], *B = number[SHEAR], *F = number[ADHESION], shortened = wall ? 0 : 0.5;
    const double *slid = slip + from;
    double *rate = slip_rate + from;
    count = left < LANES ? left : LANES;
    /* contacts come in the order of their first spheres, whose numbers stay at hand */
    for (whole c = 0; c < count;) {
      const int i = first[c];
      const double xi = x[i], yi = y[i], vxi = vx[i], vyi = vy[i], spini = spin[i];
      do {
        const int j = second[c];
        dx[c] = (wall ? 0 : x[j]) - xi;
        dy[c] = (wall ? 0 : y[j]) - yi;
        rx[c] = (wall ? 0 : vx[j]) - vxi;
        ry[c] = (wall ? 0 : vy[j]) - vyi;
        here[c] = spini;
        there[c] = wall ? 0 : spin[j];
        c++;
      } while (c < count && first[c] == i);
    }
#pragma GCC ivdep
    for (whole c = 0; c < count; c++) {
      const double nowx = ax[c] + dx[c], nowy = ay[c] + dy[c], distance = sqrt(nowx * nowx + nowy * nowy);
      const double nx = nowx / distance, ny = nowy / distance;
      const double stretch = ((ax[c] + nowx) * dx[c] + (ay[c] + nowy) * dy[c]) / (distance + length[c]);
      const double depth = gap[c] - stretch, closed = depth > 0 ? 1.0 : 0.0, overlap = depth * closed;
      const double root = sqrt(overlap), P = A[c] * overlap * root - F[c] * closed;
      const double S = B[c] * root * slid[c], arm = shortened * overlap, energy = S * slid[c];
      fx[c] = -ny * S - P * nx;
      fy[c] = nx * S - P * ny;
      on_first[c] = (R[c] - arm) * S;
      on_second[c] = (Q[c] - arm) * S;
      rate[c] = (nx * ry[c] - ny * rx[c] - R[c] * here[c] - Q[c] * there[c]) * closed;
      /* an open contact has no energy, and something to divide by */
      work[c] -= (nx * rx[c] + ny * ry[c]) * energy / (4 * overlap + (1 - closed)) + arm * S * (here[c] + there[c]);
      normal[c] += (0.4 * A[c] * overlap * root - F[c]) * overlap;
      shear[c] += energy / 2;
      const double open = slid[c] != 0 ? 1 - closed : 0.0;
      lost[c] += open + (fabs(S) > mu * (P + 2 * F[c] * closed) ? 1.0 : 0.0);
    }
    for (whole c = 0; c < count;) {
      const int i = first[c];
      double fxi = 0, fyi = 0, torque = 0;
      do {
        const int j = second[c];
        fxi += fx[c];
        fyi += fy[c];
        torque += on_first[c];
        if (!wall) {
          load[j] -= fx[c];
          load[N + j] -= fy[c];
          load[2 * N + j] += on_second[c];
        }
        c++;
      } while (c < count && first[c] == i);
      load[i] += fxi;
      load[N + i] += fyi;
      load[2 * N + i] += torque;
    }
  }
  sums[0] = sums[1] = sums[2] = sums[3] = 0;
  for (whole c = 0; c < LANES; c++) {
    sums[0] += work[c];
    sums[1] += normal[c];
    sums[2] += shear[c];
    sums[3] += lost[c];
  }
}
