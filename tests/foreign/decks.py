"""Decks as people write them, and 25 faults: each is a right deck in which lines were exchanged, added or left out.

The right decks are an adhesive sheet, a compressed chain, a chain that is struck, two spheres that meet off centre, an
adhesive pair by JKR's law, a layer on a substrate, and a run that goes on from a file.
"""

SHEET = """
units nano
dimension 2
boundary p f p
atom_style sphere
comm_modify vel yes
lattice hex 999.75014856383883 origin 0.25 0.25 0
region box block 0 4 0 4 -0.5 0.5
create_box 1 box
create_atoms 1 box
set group all diameter 1000.0
set group all density 0.0022
neighbor 50.0 bin
pair_style granular
pair_coeff * * dmt 73000.0 0.0 0.17 31.5 tangential mindlin NULL 0.0 1.0 damping velocity
variable kick atom 0.02*sin(y/500.0)
velocity all set v_kick NULL NULL
timestep 0.025
fix plane all enforce2d
fix move all nve/sphere
dump all all custom 100 dump.sheet id type x y vx vy
dump_modify all format float %.17g sort id
restart 1000 checkpoint
thermo_modify lost error
run 2000
"""

CHAIN = """
units si
dimension 2
boundary f f p
atom_style sphere
comm_modify vel yes
lattice sq 9.499e-3
region box block -1 20 -1 1 -0.5 0.5
create_box 2 box
region steel block -0.1 9.1 -0.1 0.1 -0.5 0.5
region brass block 9.9 19.1 -0.1 0.1 -0.5 0.5
create_atoms 1 region steel
create_atoms 2 region brass
set group all diameter 9.5e-3
set type 1 density 7800.0
set type 2 density 8500.0
neighbor 5e-4 bin
variable g12 equal 8/(2*(2-0.3)*(1+0.3)/2.0e11+2*(2-0.35)*(1+0.35)/1.0e11)
variable e12 equal 2*(1-0.3^2)/((1-0.3^2)/2.0e11+(1-0.35^2)/1.0e11)
pair_style granular
pair_coeff 1 1 hertz/material 2.0e11 0.0 0.3 tangential mindlin NULL 0.0 1.0 damping velocity
pair_coeff 2 2 hertz/material 1.0e11 0.0 0.35 tangential mindlin NULL 0.0 1.0 damping velocity
pair_coeff 1 2 hertz/material ${e12} 0.0 0.3 tangential mindlin ${g12} 0.0 1.0 damping velocity
group ends id 1 20
group free subtract all ends
group first id 2
velocity first set 0.001 0.001 0.0
timestep 2.0e-7
fix plane all enforce2d
fix move free nve/sphere
run 5000
"""

STRUCK = """
units si
dimension 2
boundary f f p
atom_style sphere
comm_modify vel yes
region box block -0.01 0.1 -0.01 0.01 -0.005 0.005
create_box 1 box
variable n loop 5
label next
variable x equal 0.01*(v_n-1)
create_atoms 1 single ${x} 0.0 0.0
next n
jump SELF next
set group all diameter 0.01
set group all density 7800.0
neighbor 5e-4 bin
neigh_modify every 1 delay 0 check yes
pair_style granular
pair_coeff * * hertz/material 2.0e11 0.0 0.3 tangential linear_nohistory 0.0 0.0 damping velocity
group striker id 1
velocity striker set 1.0 0.0 0.0
timestep 5e-7
fix plane all enforce2d
fix move all nve/sphere
run 2000
"""

OBLIQUE = """
units si
boundary f f f
atom_style sphere
comm_modify vel yes
region box block -0.1 0.1 -0.1 0.1 -0.1 0.1
create_box 1 box
create_atoms 1 single 0.0 0.0 0.0
create_atoms 1 single -0.012 0.006 0.0
set group all diameter 0.01
set group all density 7800.0
neighbor 5e-4 bin
pair_style granular
pair_coeff * * hertz/material 2.0e11 0.0 0.3 tangential mindlin_rescale NULL 0.0 0.5 damping velocity
group striker id 2
velocity striker set 1.0 0.0 0.0
timestep 5e-7
fix move all nve/sphere
run 10000
"""

JKR = """
units nano
boundary f f f
atom_style sphere
comm_modify vel yes
region box block -2000 2000 -2000 2000 -2000 2000
create_box 1 box
variable apart equal 999.82675
create_atoms 1 single 0.0 0.0 0.0
create_atoms 1 single ${apart} 0.0 0.0
set group all diameter 1000.0
set group all density 0.0022
neighbor 50.0 bin
pair_style granular
pair_coeff * * jkr 73000.0 0.0 0.17 31.5 tangential mindlin NULL 0.0 1.0 damping velocity
timestep 0.025
fix move all nve/sphere
run 1000
"""

LAYER = """
units nano
boundary p p f
atom_style sphere
comm_modify vel yes
lattice sc 999.75014856383883 origin 0.25 0.25 0
region box block 0 4 0 4 -2 2
create_box 1 box
region layer block 0 4 0 4 -0.1 0.1
create_atoms 1 region layer
set group all diameter 1000.0
set group all density 0.0022
neighbor 50.0 bin
pair_style granular
pair_coeff * * dmt 73000.0 0.0 0.17 31.5 tangential mindlin NULL 0.0 1.0 damping velocity
fix floor all wall/gran granular dmt 73000.0 0.0 0.17 31.5 &
    tangential mindlin NULL 0.0 1.0 damping velocity zplane -499.685206 NULL
variable kick atom 0.002*sin(x/500.0)
velocity all set NULL NULL v_kick
timestep 0.025
fix move all nve/sphere
run 1000
"""

CONTINUED = """
units si
atom_style sphere
comm_modify vel yes
boundary f f f
newton off
read_restart sheared.restart
neighbor 5e-4 bin
pair_style granular
pair_coeff * * hertz/material 2.0e11 0.0 0.3 tangential mindlin NULL 0.0 1.0 damping velocity
timestep 2.0e-7
fix move all nve/sphere
run 1000
"""

# Leaves sheared.restart and sheared.data, the state of two spheres that slip
SHEARED = """
units si
atom_style sphere
comm_modify vel yes
boundary f f f
newton off
region box block -0.1 0.1 -0.1 0.1 -0.1 0.1
create_box 1 box
create_atoms 1 single 0.0 0.0 0.0
create_atoms 1 single 9.999e-3 0.0 0.0
set group all diameter 0.01
set group all density 7800.0
neighbor 5e-4 bin
pair_style granular
pair_coeff * * hertz/material 2.0e11 0.0 0.3 tangential mindlin NULL 0.0 1.0 damping velocity
group second id 2
velocity second set 0.0 0.01 0.0
timestep 2.0e-7
fix move all nve/sphere
run 10
write_restart sheared.restart
write_data sheared.data
"""

DECKS = {
    "sheet": SHEET,
    "chain": CHAIN,
    "struck": STRUCK,
    "oblique": OBLIQUE,
    "jkr": JKR,
    "layer": LAYER,
    "continued": CONTINUED,
}

STEEL = "hertz/material 2.0e11 0.0 0.3 tangential mindlin NULL 0.0 1.0 damping velocity"
BOTH = "pair_coeff 1 2 hertz/material ${e12} 0.0 0.3 tangential mindlin ${g12} 0.0 1.0 damping velocity\n"
STIFF_FLOOR = [("wall/gran granular dmt 73000.0", "wall/gran granular dmt 200000.0"), ("-499.685206", "-499.83922")]
FLOOR = (LAYER[LAYER.index("fix floor") : LAYER.index("variable kick")], "")
# Check, deck, and the lines that are exchanged: (right, wrong). The finding stands at the last wrong line, or where a
# line is missing at the beginning of the line that is given as a third
FAULTS = [
    ("time-step", "chain", [("timestep 2.0e-7", "timestep 2.0e-6")]),
    ("collision-time", "struck", [("timestep 5e-7", "timestep 4e-6")]),
    ("first-order-damping", "sheet", [("dmt 73000.0 0.0 0.17", "dmt 73000.0 500000.0 0.17")]),
    ("rare-neighbour-lists", "struck", [("neigh_modify every 1 delay 0", "neigh_modify every 1000 delay 1000")]),
    ("thick-skin", "chain", [("neighbor 5e-4 bin", "neighbor 0.05 bin")]),
    ("adhesive-start", "sheet", [("lattice hex 999.75014856383883", "lattice hex 1000.0")]),
    ("unloaded-shear", "sheet", [("velocity all set", "displace_atoms all ramp x 0 0.1 y 0 4\nvelocity all set")]),
    ("secant-shear", "oblique", [("tangential mindlin_rescale", "tangential mindlin")]),
    ("mixed-shear-modulus", "chain", [(BOTH, "")]),
    ("wall-modulus", "layer", STIFF_FLOOR),
    ("jkr-gap", "jkr", [("variable apart equal 999.82675", "variable apart equal 1000.02")]),
    ("frozen-shear", "sheet", [("mindlin NULL 0.0 1.0", "mindlin NULL 0.0 1.0e5")]),
    ("deep-overlap", "chain", [("lattice sq 9.499e-3", "lattice sq 8.0e-3"), ("timestep 2.0e-7", "timestep 2.0e-8")]),
    ("periodic-images", "sheet", [("block 0 4 0 4", "block 0 2 0 4")]),
    ("coarse-dump", "sheet", [("format float %.17g ", "")]),
    ("frames-without-motion", "sheet", [("run 2000\n", "run 2000\nminimize 0.0 1e-9 100 1000\n")]),
    ("ghost-velocities", "sheet", [("comm_modify vel yes\n", "")]),
    ("forgotten-slip", "continued", [("read_restart sheared.restart", "read_data sheared.data")]),
    ("restart-without-law", "continued", [(f"pair_style granular\npair_coeff * * {STEEL}\n", "")]),
    ("on-periodic-face", "sheet", [("origin 0.25 0.25 0", "origin 0 0.25 0")]),
    ("lost-spheres", "sheet", [("thermo_modify lost error", "thermo_modify lost ignore")]),
    ("free-plane", "layer", [FLOOR]),
    ("not-two-dimensional", "layer", [FLOOR, ("boundary p p f", "boundary p p p"), ("4 -2 2", "4 -0.5 0.5")]),
    ("discs", "sheet", [("nve/sphere", "nve/sphere disc")]),
    ("no-rotation", "sheet", [("nve/sphere", "nve")]),
]
