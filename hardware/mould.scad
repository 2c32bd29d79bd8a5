// A mould for the pad of config.toml: a tray, and a lid whose pin leaves the magnet's place. Millimetres.
// `make mould` makes both parts as STL.

part = "both";              // "tray", "lid" or "both"
pad_size = [40, 40, 4];     // of the silicone
magnet_diameter = 2;
magnet_length = 2;
magnet_height = 2;          // of its centre above the tray's floor, which is the pad's lower face
wall = 3;
clearance = 0.15;           // between lid and tray, and between pin and magnet: the magnet must go in
bar = 8;                    // width of the lid's two bars
bar_height = 3;
draft = 0.3;                // how much wider the tray is at its rim, so that the pad comes out

floor_to_magnet = magnet_height - magnet_length / 2;
assert(floor_to_magnet > 0.3, "the magnet would touch the pad's lower face");
assert(pad_size[2] - floor_to_magnet - magnet_length > 0.3, "the magnet would touch the pad's upper face");

module tray() {
    difference() {
        translate([-pad_size[0] / 2 - wall, -pad_size[1] / 2 - wall, -wall])
            cube([pad_size[0] + 2 * wall, pad_size[1] + 2 * wall, pad_size[2] + wall]);
        hull() {
            translate([-pad_size[0] / 2, -pad_size[1] / 2, 0]) cube([pad_size[0], pad_size[1], 0.01]);
            translate([-pad_size[0] / 2 - draft, -pad_size[1] / 2 - draft, pad_size[2]])
                cube([pad_size[0] + 2 * draft, pad_size[1] + 2 * draft, 0.01]);
        }
        // A step in the rim shows how far to pour first: to the magnet's upper face. It lies beside the lid's bars.
        translate([pad_size[0] / 2 - 1, bar + 2, floor_to_magnet + magnet_length]) cube([wall, 4, pad_size[2]]);
    }
}

// Lies on the rim. Its pin ends where the magnet will stand, so that the first pour keeps its place free.
module lid() {
    beam(pad_size[0]);
    rotate(90) beam(pad_size[1]);
    translate([0, 0, floor_to_magnet])
        cylinder(d = magnet_diameter + 2 * clearance, h = pad_size[2] - floor_to_magnet + 1, $fn = 48);
}

// Lies across the tray, which is `across` wide inside. Tabs at both ends hold it in the middle.
module beam(across) {
    reach = across / 2 + wall + clearance + 2;
    translate([-reach, -bar / 2, pad_size[2]]) cube([2 * reach, bar, bar_height]);
    for (side = [-1, 1])
        translate([side * (reach - 1) - 1, -bar / 2, pad_size[2] - 3]) cube([2, bar, bar_height + 3]);
}

if (part != "lid") tray();
if (part == "both") translate([0, pad_size[1] + 4 * wall, 0]) lid();
// Alone, as it is printed: its bars lie on the printer's bed, and its pin points up.
if (part == "lid") translate([0, 0, pad_size[2] + bar_height]) rotate([180, 0, 0]) lid();
