/* The least that particles cost: velocity Verlet over a list of contacts that is made once.

   Contacts never part nor meet, all spheres are equal, and places are displacements from rest, so that no digits are
   lost. The law is that of analysis/granular_analysis/theory/network.py, whose slip is a number; it starts with the slip of one step from
   rest to the wave. As in LAMMPS it grows along the tangent at the end of a step, which leaves an error of first order
   below 1e-5 of p. SI units. */

#include <math.h>

/* apart: vector from i to j at rest. u: x, y and angle of each sphere; v: their rates; f: forces and torque. */
static void forces(int spheres, int contacts, const int (*pair)[2], const double (*apart)[2], const double (*u)[3],
                   const double (*v)[3], double (*f)[3], double *slip, double dt, double R, double A, double B, double F)
{
  for (int i = 0; i < spheres; i++) f[i][0] = f[i][1] = f[i][2] = 0;
  for (int c = 0; c < contacts; c++) {
    const int i = pair[c][0], j = pair[c][1];
    const double x = apart[c][0] + u[j][0] - u[i][0], y = apart[c][1] + u[j][1] - u[i][1];
    const double r = sqrt(x * x + y * y), nx = x / r, ny = y / r, overlap = 2 * R - r, root = sqrt(overlap);
    slip[c] += dt * (nx * (v[j][1] - v[i][1]) - ny * (v[j][0] - v[i][0]) - R * (v[i][2] + v[j][2]));
    const double push = A * overlap * root - F, shear = B * root * slip[c], torque = (R - overlap / 2) * shear;
    const double fx = -push * nx - shear * ny, fy = -push * ny + shear * nx;
    f[i][0] += fx;
    f[i][1] += fy;
    f[i][2] += torque;
    f[j][0] -= fx;
    f[j][1] -= fy;
    f[j][2] += torque;
  }
}

/* record: x and y of the centre sphere at the start and every so many steps. */
void run(int spheres, int contacts, const int (*pair)[2], const double (*apart)[2], double (*u)[3], double (*v)[3],
         double (*f)[3], double *slip, const double *moving, double dt, int steps, int every, int centre,
         const double *sphere, double (*record)[2])
{
  const double R = sphere[0], A = sphere[1], B = sphere[2], F = sphere[3], m = sphere[4], inertia = sphere[5];
  forces(spheres, contacts, pair, apart, u, u, f, slip, 1.0, R, A, B, F); /* the way from rest, in one step */
  for (int step = 0;; step++) {
    if (step % every == 0) {
      record[step / every][0] = u[centre][0];
      record[step / every][1] = u[centre][1];
    }
    if (step == steps) return;
    for (int i = 0; i < spheres; i++)
      for (int d = 0; d < 3; d++) {
        v[i][d] += moving[i] * 0.5 * dt * f[i][d] / (d < 2 ? m : inertia);
        u[i][d] += moving[i] * dt * v[i][d];
      }
    forces(spheres, contacts, pair, apart, u, v, f, slip, dt, R, A, B, F);
    for (int i = 0; i < spheres; i++)
      for (int d = 0; d < 3; d++) v[i][d] += moving[i] * 0.5 * dt * f[i][d] / (d < 2 ? m : inertia);
  }
}
