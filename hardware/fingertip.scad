// A fingertip for a robot hand: a box with the pad of config.toml on its face, the boards and the cable within.
// Millimetres. Axes as in fingertip-*.urdf: the origin is on the axis of the hand's last joint, y along that axis, z
// along the finger, x toward what is touched. `make fingertip` makes all parts as STL.

hand = "leap";              // "leap": a fork for the horns of its motor; "allegro": screws to a printed fork, see below
part = "body";              // "body" or "lid"
pad_size = [40, 40, 4];     // of the silicone, along z, y and x
boards = [50.8, 50.8];      // four breakouts of 25.4 mm side by side, along z and y: chips at ±12.7 mm
board_thickness = 1.6;
chip_height = 1;            // above its board
cable = 6;                  // its diameter
chips_apart = 25.4;
from_steel = 30;            // the nearest chip from the hand's motor

plate = 3;                  // under the pad's rim
rim = 3;                    // of the pad, which is glued; within it the silicone must be free to sink: the contact model
                            // was made so, and a pad that is glued all over hardly moves its magnet
plate_above_chips = 10;     // as in docs/build-a-pad.md: the magnet is 2 mm above it
wall = 2.4;
clearance = 0.3;            // on each side of what is put in
screw_hole = 1.7;           // an M2 screw cuts its own thread
post = 4;
ledge = 1.2;                // on which the boards' edges lie

// LEAP hand, measured in the mesh of its fingertip (leap-hand/LEAP_Hand_Sim, assets/leap_hand/fingertip.stl):
// the motor's horns are 29 mm apart; each has four M2 screws 6 mm from its axis, and a head of 6 mm in the middle. The
// motor needs 14 mm from its axis to the fingertip.
leap = [["apart", 29], ["cheek", 2.8], ["circle", 6], ["screw", 2.05], ["middle", 6], ["free", 14], ["width", 20]];
// Allegro hand: the fork that DIGIT is screwed to (facebookresearch/digit-design, DIGIT/adaptors/Allegro) has six M2
// screws, three at 6 mm in each of two rows at 10 mm; its face is 15 mm from the joint's axis, 22.6 mm × 23 mm large.
allegro = [["pitch", 6], ["rows", 10], ["free", 15], ["depth", 5]];
assert(hand == "leap" || hand == "allegro", "hand: \"leap\" or \"allegro\"");
function of(table, name) = table[search([name], table)[0]][1];

free = hand == "leap" ? of(leap, "free") : of(allegro, "free");
base = hand == "leap" ? 4 : 6;
inside = [boards[0] + 2 * clearance, boards[1] + 2 * clearance];
outside = [inside[0] + 2 * wall, inside[1] + 2 * wall];
middle = max(free + base + inside[0] / 2, free + from_steel + chips_apart / 2);  // of pad and boards, along z
room = cable + 2 * clearance;  // below the boards, for cable and plugs
top = plate_above_chips;    // above the chips' faces, where x is 0
board_top = -chip_height;
bottom = board_top - board_thickness - room;
lid_thickness = 2;
module at_pad() { translate([0, 0, middle]) children(); }

module body() {
    difference() {
        union() {
            at_pad() block([bottom - lid_thickness, top], outside[1], outside[0]);
            translate([0, 0, free]) from_base([bottom - lid_thickness, top], hand == "leap" ? 34.6 : 26, middle - free);
            at_pad() stops();
            if (hand == "leap") fork();
        }
        // From below: room for the boards and what hangs on them, then the lid, which lies on a step.
        at_pad() block([bottom - lid_thickness - 1, board_top], inside[1], inside[0]);
        // Above the boards, less a ledge all around on which their edges lie.
        at_pad() block([board_top - 1, top - plate], inside[1] - 2 * ledge, inside[0] - 2 * ledge);
        // The window under the pad.
        at_pad() block([top - plate - 1, top + 1], pad_size[1] - 2 * rim, pad_size[0] - 2 * rim);
        // The cable leaves through the neck, and turns to the back of the finger before the motor.
        way = cable + 2 * clearance;
        translate([bottom + room / 2, 0, exit()]) cylinder(d = way, h = middle - exit(), $fn = 48);
        translate([bottom - lid_thickness - 1, 0, exit()]) rotate([0, 90, 0])
            cylinder(d = way, h = lid_thickness + 1 + room / 2, $fn = 48);
        translate([bottom + room / 2, 0, exit()]) sphere(d = way, $fn = 48);
        if (hand == "allegro") grid();
        at_pad() lid_screws(2.2, outside[1] + 2);
    }
}

function exit() = middle - boards[0] / 2 - cable;

// x: from, to; centred along y and z.
module block(x, y, z) { translate([x[0], -y / 2, -z / 2]) cube([x[1] - x[0], y, z]); }
module from_base(x, y, z) { translate([x[0], -y / 2, 0]) cube([x[1] - x[0], y, z]); }

// Four low corners show where the pad is glued; between them the silicone may bulge.
module stops() {
    for (side = [-1, 1], end = [-1, 1])
        translate([top, side * (pad_size[1] / 2 + clearance), end * (pad_size[0] / 2 + clearance)])
            for (turn = [[5, 1], [1, 5]])
                translate([-0.1, side > 0 ? 1 - turn[0] : -1, end > 0 ? 1 - turn[1] : -1]) cube([0.7, turn[0], turn[1]]);
}

module fork() {
    apart = of(leap, "apart");
    cheek = of(leap, "cheek");
    width = of(leap, "width");
    for (side = [-1, 1]) difference() {
        hull() {
            cheek_at(side) cylinder(d = width, h = cheek, $fn = 96);
            translate([-width / 2, side > 0 ? apart / 2 : -apart / 2 - cheek, free]) cube([width, cheek, 0.5]);
        }
        cheek_at(side) translate([0, 0, -1]) cylinder(d = of(leap, "middle"), h = cheek + 2, $fn = 48);
        for (turn = [0, 90, 180, 270]) cheek_at(side) rotate(turn) translate([of(leap, "circle"), 0, -1]) {
            cylinder(d = of(leap, "screw"), h = cheek + 2, $fn = 24);
            translate([0, 0, 1 + cheek / 2]) cylinder(d = 4, h = cheek, $fn = 24);  // the screw's head, from outside
        }
    }
}
// Along the joint's axis, from the inner face of a cheek outward.
module cheek_at(side) { translate([0, side * of(leap, "apart") / 2, 0]) rotate([side > 0 ? -90 : 90, 0, 0]) children(); }

module grid() {
    for (row = [-1, 1], column = [-1, 0, 1])
        translate([(top + bottom - lid_thickness) / 2 + row * of(allegro, "rows") / 2, column * of(allegro, "pitch"), free - 1])
            cylinder(d = screw_hole, h = of(allegro, "depth") + 1, $fn = 24);
}

// Two nylon screws M2 from each side go through the box into the lid's posts.
module lid_screws(diameter, length) {
    for (end = [-1, 1]) translate([bottom + room / 2, 0, end * (inside[0] / 2 - clearance - post / 2)])
        rotate([90, 0, 0]) cylinder(d = diameter, h = length, center = true, $fn = 24);
}

// Closes the box from the back: its posts press the boards' corners against the ledge.
module lid() {
    size = [inside[0] - 2 * clearance, inside[1] - 2 * clearance];
    // As it is printed; in the finger its lower face is the finger's back.
    rotate([0, -90, 0]) translate([-(bottom - lid_thickness), 0, 0]) difference() {
        union() {
            block([bottom - lid_thickness, bottom], size[1], size[0]);
            for (side = [-1, 1], end = [-1, 1])
                translate([0, side * (size[1] - post) / 2, end * (size[0] - post) / 2])
                    block([bottom - lid_thickness, bottom + room], post, post);
        }
        lid_screws(screw_hole, outside[1]);
    }
}

if (part == "body") body();
if (part == "lid") lid();
