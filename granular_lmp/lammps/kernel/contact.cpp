/* The contact of adhesive spheres in the plane as one loop: LAMMPS's pair style granular for the laws of the decks.

   Two spheres at an overlap d and a slip s push each other with

       f_N = K a d - F,   f_S = -8 G a s,   |f_S| <= mu (f_N + 2 F),   a = sqrt(Rc d),   F = 4 pi gamma Rc

   (without adhesion F = 0). The slip grows by the relative velocity of the surfaces, with the full radii, and turns with
   the contact; the torque of f_S has the lever arm R - d/2. A contact that opens forgets its slip, and one that slides
   keeps that of its limit. All as in https://docs.lammps.org/pair_granular.html. The style is granular/kernel, which
   LAMMPS takes for granular under "suffix kernel", so that a deck needs no other line:

       pair_coeff M N dmt E 0 nu gamma tangential mindlin NULL 0 mu damping velocity
       pair_coeff M N hertz/material E 0 nu tangential mindlin NULL 0 mu damping velocity

   Everything else is an error: other laws, three dimensions, several ranks, mixing. Restart files hold no slip. */

#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "force.h"
#include "lammps.h"
#include "memory.h"
#include "neigh_list.h"
#include "neighbor.h"
#include "pair.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

using namespace LAMMPS_NS;

namespace {

struct Law {
  double stiffness, shear, adhesion, friction;    // K = 4/3 E*, 8 G*, 4 pi gamma, mu
};

struct Slips {    // the slip of each pair of the neighbour list, in rows of the first sphere
  std::vector<int> row, length;    // by tag
  std::vector<tagint> partner;
  std::vector<double> slip;    // x, y

  int find(tagint first, tagint second) const
  {
    if (first >= (tagint) row.size()) return -1;
    for (int k = row[first]; k < row[first] + length[first]; k++)
      if (partner[k] == second) return k;
    return -1;
  }
};

class PairKernel : public Pair {
  std::vector<Law> laws;    // by both types
  Slips slips;

  // LAMMPS turns a slip only if its normal part matters by more than this share of the sliding force
  static constexpr double TURNED = 1e-10;

  Law &law(int m, int n) { return laws[m * (atom->ntypes + 1) + n]; }

  void renew()
  {
    Slips before;
    std::swap(before, slips);
    slips.row.assign(atom->map_tag_max + 1, 0);
    slips.length.assign(atom->map_tag_max + 1, 0);
    for (int ii = 0; ii < list->inum; ii++) {
      const int i = list->ilist[ii];
      const tagint first = atom->tag[i];
      slips.row[first] = (int) slips.partner.size();
      slips.length[first] = list->numneigh[i];
      for (int jj = 0; jj < list->numneigh[i]; jj++) {
        const tagint second = atom->tag[list->firstneigh[i][jj] & NEIGHMASK];
        const int same = before.find(first, second), turned = same < 0 ? before.find(second, first) : -1;
        slips.partner.push_back(second);
        for (int c = 0; c < 2; c++)
          slips.slip.push_back(same >= 0 ? before.slip[2 * same + c] : turned >= 0 ? -before.slip[2 * turned + c] : 0.0);
      }
    }
  }

 public:
  PairKernel(LAMMPS *lmp) : Pair(lmp)
  {
    restartinfo = 0;
    no_virial_fdotr_compute = 1;
    finitecutflag = 1;
    single_extra = 12;
    svector = new double[single_extra]();
  }

  ~PairKernel() override
  {
    delete[] svector;
    if (allocated) {
      memory->destroy(setflag);
      memory->destroy(cutsq);
    }
  }

  void settings(int count, char **) override
  {
    if (count) error->all(FLERR, "kernel: pair_style granular takes no cutoff");
  }

  void coeff(int count, char **words) override
  {
    if (!allocated) {
      allocated = 1;
      memory->create(setflag, atom->ntypes + 1, atom->ntypes + 1, "kernel:setflag");
      memory->create(cutsq, atom->ntypes + 1, atom->ntypes + 1, "kernel:cutsq");
      for (int m = 0; m <= atom->ntypes; m++) std::fill_n(setflag[m], atom->ntypes + 1, 0);
      laws.resize((atom->ntypes + 1) * (atom->ntypes + 1));
    }
    std::vector<std::string> given(words + std::min(count, 2), words + count);
    const std::string normal = given.empty() ? "" : given[0];
    std::vector<std::string> known{normal, "E", "0", "nu"};
    if (normal == "dmt") known.push_back("gamma");
    else if (normal != "hertz/material") error->all(FLERR, "kernel: normal law '{}': must be dmt or hertz/material", normal);
    for (const char *word : {"tangential", "mindlin", "NULL", "0", "mu", "damping", "velocity"}) known.push_back(word);
    std::vector<double> number;
    for (size_t k = 0; k < std::max(known.size(), given.size()); k++) {
      const std::string wanted = k < known.size() ? known[k] : "nothing", word = k < given.size() ? given[k] : "";
      const bool any = wanted == "E" || wanted == "nu" || wanted == "gamma" || wanted == "mu";
      if (any) number.push_back(utils::numeric(FLERR, word, false, lmp));
      else if (wanted == "0" ? utils::numeric(FLERR, word, false, lmp) != 0.0 : wanted != word)
        error->all(FLERR, "kernel: pair_coeff has '{}' where it takes {} only", word, wanted);
    }
    const double E = number[0], nu = number[1];
    const Law found{4.0 / 3.0 * E / (2 * (1 - nu * nu)), 8 * E / (4 * (2 - nu) * (1 + nu)),
                    normal == "dmt" ? 4 * M_PI * number[2] : 0.0, number.back()};
    int low[2], high[2];
    for (int side = 0; side < 2; side++) utils::bounds(FLERR, words[side], 1, atom->ntypes, low[side], high[side], error);
    for (int m = low[0]; m <= high[0]; m++)
      for (int n = std::max(low[1], m); n <= high[1]; n++) {
        law(m, n) = law(n, m) = found;
        setflag[m][n] = 1;
      }
  }

  void init_style() override
  {
    if (comm->nprocs > 1) error->all(FLERR, "kernel: {} ranks: must be one", comm->nprocs);
    if (domain->dimension != 2) error->all(FLERR, "kernel: dimension {}: must be 2", domain->dimension);
    if (!atom->radius_flag || !atom->omega_flag || !atom->torque_flag || !atom->tag_enable)
      error->all(FLERR, "kernel: needs atom_style sphere, with identifiers");
    if (!comm->ghost_velocity) error->all(FLERR, "kernel: needs comm_modify vel yes");
    neighbor->add_request(this, NeighConst::REQ_SIZE);
  }

  double init_one(int m, int n) override
  {
    if (!setflag[m][n]) error->all(FLERR, "kernel: types {} and {} have no pair_coeff", m, n);
    double largest[2] = {0.0, 0.0};
    for (int i = 0; i < atom->nlocal; i++)
      for (int side = 0; side < 2; side++)
        if (atom->type[i] == (side ? n : m)) largest[side] = std::max(largest[side], atom->radius[i]);
    return largest[0] + largest[1];
  }

  void compute(int eflag, int vflag) override
  {
    ev_init(eflag, vflag);
    if (neighbor->ago == 0) renew();
    const double(*x)[3] = (const double(*)[3]) atom->x[0], (*v)[3] = (const double(*)[3]) atom->v[0];
    const double(*omega)[3] = (const double(*)[3]) atom->omega[0], *radius = atom->radius;
    double(*force)[3] = (double(*)[3]) atom->f[0], (*torque)[3] = (double(*)[3]) atom->torque[0];
    const int *type = atom->type, nlocal = atom->nlocal, newton = this->force->newton_pair;
    const double dt = update->dt;
    const bool moves = !update->setupflag;

    for (int ii = 0; ii < list->inum; ii++) {
      const int i = list->ilist[ii], *neighbours = list->firstneigh[i], count = list->numneigh[i];
      const double xi = x[i][0], yi = x[i][1], ri = radius[i];
      const Law *row = &laws[type[i] * (atom->ntypes + 1)];
      double *s = slips.slip.data() + 2 * slips.row[atom->tag[i]], fx = 0, fy = 0, turn = 0;
      for (int jj = 0; jj < count; jj++, s += 2) {
        const int j = neighbours[jj] & NEIGHMASK;
        const double dx = xi - x[j][0], dy = yi - x[j][1], rj = radius[j], sum = ri + rj, rsq = dx * dx + dy * dy;
        if (rsq >= sum * sum) {
          s[0] = s[1] = 0.0;
          continue;
        }
        const Law &c = row[type[j]];
        const double r = std::sqrt(rsq), nx = dx / r, ny = dy / r, overlap = sum - r, Rc = ri * rj / sum;
        const double a = std::sqrt(Rc * overlap), repulsion = c.stiffness * a * overlap, F = c.adhesion * Rc;
        const double shear = c.shear * a, limit = c.friction * std::fabs(repulsion + F);
        double sx = s[0], sy = s[1];
        if (moves) {
          const double along = sx * nx + sy * ny;
          if (std::fabs(along) * shear > TURNED * limit) {    // its length is kept
            const double length = std::sqrt(sx * sx + sy * sy);
            sx -= along * nx;
            sy -= along * ny;
            const double flat = std::sqrt(sx * sx + sy * sy), scale = flat > 0 ? length / flat : 0.0;
            sx *= scale;
            sy *= scale;
          }
          const double ux = v[i][0] - v[j][0], uy = v[i][1] - v[j][1], un = ux * nx + uy * ny;
          const double roll = ri * omega[i][2] + rj * omega[j][2];
          sx += dt * (ux - un * nx + roll * ny);
          sy += dt * (uy - un * ny - roll * nx);
        }
        double gx = -shear * sx, gy = -shear * sy;
        const double hard = gx * gx + gy * gy;
        if (hard > limit * limit) {
          const double part = limit / std::sqrt(hard);
          gx *= part;
          gy *= part;
          sx *= part;
          sy *= part;
        }
        s[0] = sx;
        s[1] = sy;
        const double px = (repulsion - F) * nx + gx, py = (repulsion - F) * ny + gy, lever = nx * gy - ny * gx;
        fx += px;
        fy += py;
        turn -= (ri - 0.5 * overlap) * lever;
        if (newton || j < nlocal) {
          force[j][0] -= px;
          force[j][1] -= py;
          torque[j][2] -= (rj - 0.5 * overlap) * lever;
        }
        if (evflag) ev_tally_xyz(i, j, nlocal, newton, 0.0, 0.0, px, py, 0.0, dx, dy, 0.0);
      }
      force[i][0] += fx;
      force[i][1] += fy;
      torque[i][2] += turn;
    }
  }

  // For compute pair/local: p1 and p2 are the shear force on i, p4 its magnitude, p10 and p11 the vector from j to i
  double single(int i, int j, int m, int n, double rsq, double, double, double &fforce) override
  {
    std::fill_n(svector, single_extra, 0.0);
    fforce = 0.0;
    const double sum = atom->radius[i] + atom->radius[j];
    if (rsq >= sum * sum) return 0.0;
    const Law &c = law(m, n);
    const double r = std::sqrt(rsq), overlap = sum - r, Rc = atom->radius[i] * atom->radius[j] / sum;
    const double a = std::sqrt(Rc * overlap);
    fforce = (c.stiffness * a * overlap - c.adhesion * Rc) / r;
    int k = slips.find(atom->tag[i], atom->tag[j]);
    const double shear = k >= 0 ? -c.shear * a : c.shear * a;    // the slip of j on i is the opposite
    if (k < 0) k = slips.find(atom->tag[j], atom->tag[i]);
    if (k < 0) error->one(FLERR, "kernel: a contact that is in no neighbour list");
    for (int d = 0; d < 2; d++) {
      svector[d] = shear * slips.slip[2 * k + d];
      svector[9 + d] = atom->x[i][d] - atom->x[j][d];
    }
    svector[3] = std::sqrt(svector[0] * svector[0] + svector[1] * svector[1]);
    return 0.0;
  }
};

Pair *make(LAMMPS *lmp)
{
  return new PairKernel(lmp);
}

// What a plugin says of itself: https://docs.lammps.org/Developer_plugins.html
struct Plugin {
  const char *version, *style, *name, *info, *author;
  union {
    void *(*plain)(LAMMPS *);
    void *(*with_words)(LAMMPS *, int, char **);
  } creator;
  void *handle;
};

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *registration)
{
  Plugin said{};
  said.version = ((LAMMPS *) lmp)->version;
  said.style = "pair";
  said.name = "granular/kernel";
  said.info = "contacts of granular-lmp";
  said.author = "granular-lmp";
  said.creator.plain = (void *(*) (LAMMPS *) ) & make;
  said.handle = handle;
  ((void (*)(Plugin *, void *)) registration)(&said, lmp);
}
