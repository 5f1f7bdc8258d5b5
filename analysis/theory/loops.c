/* Loops over numbers and contacts, compiled where there is a compiler (loops.py).

   What each computes stands in Python beside its caller, with NumPy: integrator.py and network_state.py. Here it is
   one pass in place of dozens, with the same formulas. Sums that NumPy takes in another order round otherwise. */

#ifndef NUMBER
#include <complex.h>
#include <math.h>
#include <stddef.h>

typedef ptrdiff_t whole; /* intp of NumPy */
enum { LANES = 64 }; /* numbers that stay in the nearest cache together */

/* The widest vectors of the processor at hand; without fused products all of them give the same bits */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VECTORS __attribute__((target_clones("avx2", "default")))
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
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

/* squares[e] = sum over n numbers of (Σ_r weights[e][r] slopes[r] / (atol + rtol max(|begin|, |after|)))², e = 0, 1;
   with a tolerance for each number, or one for all. */
VECTORS void errors(whole n, whole rows, const double *weights, const double *slopes, const double *begin,
                    const double *after, const double *atol, whole each, double rtol, double *squares)
{
  double total[2][LANES] = {{0}};
  for (whole from = 0; from < n; from += LANES) {
    const whole count = n - from < LANES ? n - from : LANES;
    double scale[LANES], sum[2][LANES] = {{0}};
    for (whole i = 0; i < count; i++) {
      const double a = fabs(begin[from + i]), b = fabs(after[from + i]);
      scale[i] = (each ? atol[from + i] : atol[0]) + rtol * (a > b ? a : b);
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

/* Spheres in a row of chain.py without dashpots: displacements and velocities in units of chain_motion.py. */
typedef struct {
  whole spheres;
  const double *stiffness, *overlap, *load, *mass;
  double length, scale;
} Chain;

void chain(const Chain *c, const double *state, double *rate)
{
  const whole n = c->spheres;
  double left = 0, behind = 0; /* the sphere to the left of a contact, and the force of that before it */
  for (whole i = 0; i <= n; i++) {
    const double right = i < n ? state[i] * c->length : 0, depth = left - right + c->overlap[i];
    const double force = depth > 0 ? depth * sqrt(depth) * c->stiffness[i] : 0;
    if (i > 0) {
      rate[i - 1] = state[n + i - 1];
      rate[n + i - 1] = (behind - force + c->load[i - 1]) / c->mass[i - 1] * c->scale;
    }
    left = right;
    behind = force;
  }
}

/* Waves on the phase torus of K points, real or complex, as of lattice.py: a state has the rows p, q, φ, their rates,
   with `history` the shear of the contacts ahead, and with `works` the work of the shear law as of energy.py, (6 to 10,
   K) a wave. */
enum { BONDS = 3, MOST = 128 };
typedef struct {
  whole waves, points, history, incremental, potential, works;
  const double *shifts, *back; /* to the neighbours ahead (K, 3K), and its transpose */
  double along[BONDS], across[BONDS]; /* p and q of the directions at rest */
  double A, F, shear, length, overlap_ratio; /* a length of 0: directions are fixed */
  double dashpot, softens; /* and whether a dashpot goes as the root of the contact radius */
  double mobility[3];
  double sign; /* of the work */
} Torus;

INLINE double root_of(double x) { return sqrt(x); }
INLINE double ratio(double x, double y) { return x / y; }

/* Of a number whose real part is not negative, as those of contacts that stay closed */
INLINE double complex root_of_complex(double complex z)
{
  const double x = creal(z), y = cimag(z), half = sqrt((sqrt(x * x + y * y) + x) / 2);
  return half != 0 ? half + I * (y / (2 * half)) : 0;
}

INLINE double complex ratio_complex(double complex z, double complex w)
{
  const double u = creal(w), v = cimag(w);
  return z * conj(w) / (u * u + v * v);
}

/* This file reads its last part twice, once for each kind of number. */
#define NUMBER double
#define OF(name) name
#include "loops.c"
#undef NUMBER
#undef OF
#define NUMBER double complex
#define OF(name) name##_complex
#include "loops.c"

/* The slopes first to last of a step of a Runge-Kutta method: each of the sum of the rows before it, with the weights of
   its row of 17. stack: the state, then the slopes, n numbers a row; trial: where the last was taken. */
void stages(whole n, whole first, whole last, whole width, const double *weights, double *stack, double *trial,
            void (*slope)(const void *, const double *, double *), const void *data)
{
  for (whole row = first; row <= last; row++) {
    weighted(n, row + 1, weights + row * width, stack, n, trial);
    slope(data, trial, stack + (row + 1) * n);
  }
}

/* `count` steps of velocity Verlet, as of timestep.py: the slip grows with the speeds of half a step. */
void stepped(const Torus *t, double *state, double *rate, double step, whole count)
{
  const whole speeds = 3 * t->points, memory = 6 * t->points, size = (t->history ? 9 : 6) * t->points;
  torus(t, state, rate);
  for (whole n = 0; n < count; n++) {
    for (whole i = speeds; i < memory; i++) state[i] += step / 2 * rate[i];
    for (whole i = 0; i < speeds; i++) state[i] += step * state[speeds + i];
    if (t->history) {
      torus(t, state, rate);
      for (whole i = memory; i < size; i++) state[i] += step * rate[i];
    }
    torus(t, state, rate);
    for (whole i = speeds; i < memory; i++) state[i] += step / 2 * rate[i];
  }
}

#else

/* out = values of K points @ matrix (K, n) */
INLINE void OF(shifted)(whole K, whole n, const NUMBER *values, const double *matrix, NUMBER *out)
{
  for (whole i = 0; i < n; i++) out[i] = 0;
  for (whole k = 0; k < K; k++)
    for (whole i = 0; i < n; i++) out[i] += values[k] * matrix[k * n + i];
}

/* n·d, t·d, σ (3, 3K) of the contacts ahead, from p, q, φ (3, K) */
INLINE void OF(deformed)(const Torus *t, const NUMBER *places, NUMBER apart[3][BONDS * MOST])
{
  const whole K = t->points;
  for (int row = 0; row < 3; row++) {
    const double sign = row < 2 ? -1 : 1;
    const NUMBER *here = places + row * K;
    OF(shifted)(K, BONDS * K, here, t->shifts, apart[row]);
    for (int bond = 0; bond < BONDS; bond++)
      for (whole k = 0; k < K; k++) apart[row][bond * K + k] += sign * here[k];
  }
  for (int bond = 0; bond < BONDS; bond++)
    for (whole k = bond * K; k < (bond + 1) * K; k++) {
      const NUMBER p = apart[0][k], q = apart[1][k];
      apart[0][k] = t->along[bond] * p + t->across[bond] * q;
      apart[1][k] = t->along[bond] * q - t->across[bond] * p;
    }
}

/* rate = the time derivative of a state, `lattice.rhs` */
VECTORS void OF(torus)(const Torus *t, const NUMBER *states, NUMBER *rates)
{
  const whole K = t->points, M = BONDS * K, last = (t->history ? 9 : 6) * K, size = last + (t->works ? K : 0);
  for (whole wave = 0; wave < t->waves; wave++) {
    const NUMBER *state = states + wave * size, *memory = state + 6 * K;
    NUMBER *rate = rates + wave * size;
    NUMBER apart[3][BONDS * MOST], moving[3][BONDS * MOST], pull[3][BONDS * MOST], behind[MOST], power[BONDS * MOST];
    OF(deformed)(t, state, apart);
    if (t->history || t->works || t->dashpot != 0)
      OF(deformed)(t, state + 3 * K, moving);
    else
      for (int row = 0; row < 3; row++)
        for (whole m = 0; m < M; m++) moving[row][m] = 0;
#pragma GCC ivdep
    for (whole m = 0; m < M; m++) {
      const NUMBER n = apart[0][m], s = apart[1][m], ahead = t->length + n, excess = (t->length + ahead) * n + s * s;
      const NUMBER distance = t->length != 0 ? OF(root_of)(t->length * t->length + excess) : 1;
      const NUMBER cosine = t->length != 0 ? OF(ratio)(ahead, distance) : 1;
      const NUMBER sine = t->length != 0 ? OF(ratio)(s, distance) : 0;
      const NUMBER stretch = t->length != 0 ? OF(ratio)(excess, distance + t->length) : n;
      const NUMBER overlap = creal(stretch) < 1 ? 1 - stretch : 0, root = OF(root_of)(overlap);
      const NUMBER opening = cosine * moving[0][m] + sine * moving[1][m];
      const NUMBER slipping = cosine * moving[1][m] - sine * moving[0][m] - moving[2][m];
      const NUMBER slip = t->history ? memory[m] : cosine * s - sine * n - apart[2][m];
      const NUMBER spring = t->history && t->incremental ? slip : t->shear * root * slip;
      const NUMBER pushed = t->potential && creal(overlap) > 0 ? OF(ratio)(spring * slip, 4 * overlap) : 0;
      const NUMBER resists = t->dashpot * (t->softens != 0 ? OF(root_of)(root) : creal(overlap) > 0 ? 1.0 : 0.0);
      const NUMBER N = t->F - t->A * overlap * root - pushed + resists * opening;
      const NUMBER S = spring + (t->shear != 0 ? resists * slipping : 0);
      const NUMBER sheared = t->history && t->incremental ? OF(ratio)(slip, t->shear * root) : slip;
      const NUMBER growth = creal(overlap) > 0 ? OF(ratio)(0.5, root) : 0;
      power[m] = -0.5 * t->sign * t->shear * growth * sheared * sheared * moving[0][m];
      pull[0][m] = cosine * N - sine * S;
      pull[1][m] = sine * N + cosine * S;
      pull[2][m] = S * (1 - t->overlap_ratio * overlap);
      moving[2][m] = t->incremental ? t->shear * root * slipping : slipping;
    }
    for (whole k = 0; k < 3 * K; k++) rate[k] = state[3 * K + k];
    if (t->history)
      for (whole m = 0; m < M; m++) rate[6 * K + m] = moving[2][m];
    if (t->works)
      for (whole k = 0; k < K; k++) rate[last + k] = power[k] + power[K + k] + power[2 * K + k];
    for (int bond = 0; bond < BONDS; bond++)
      for (whole m = bond * K; m < (bond + 1) * K; m++) {
        const NUMBER n = pull[0][m], s = pull[1][m];
        pull[0][m] = t->along[bond] * n - t->across[bond] * s;
        pull[1][m] = t->across[bond] * n + t->along[bond] * s;
      }
    for (int row = 0; row < 3; row++) {
      NUMBER *force = rate + (3 + row) * K;
      OF(shifted)(M, K, pull[row], t->back, behind);
      for (whole k = 0; k < K; k++) {
        const NUMBER ahead = pull[row][k] + pull[row][K + k] + pull[row][2 * K + k];
        force[k] = t->mobility[row] * (row < 2 ? ahead - behind[k] : ahead + behind[k]);
      }
    }
  }
}

#endif
