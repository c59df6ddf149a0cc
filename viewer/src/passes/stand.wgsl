// Where an instance stands: the three rows of its transform, and the section that carries it or −1.
struct Standing {
    x: vec4f,
    y: vec4f,
    z: vec4f,
    ride: i32,
}
//#if STAND
// Plants that stand in many places and are stored once. A draw has the first so many leaves of each of its plants: all
// leaves of a plant, then those of the next. `stand.rs` chooses the plants of each draw.

struct StandDraw {
    // x: number of leaves of each plant. y: the first plant.
    numbers: vec4u,
    // The middle of the leaf's mesh, about which it is enlarged.
    middle: vec4f,
}

@group(3) @binding(0) var<uniform> stand_draw: StandDraw;
// For each leaf its rows in the plant's frame, from the point of the section that carries it if one does. The last row
// has that section (−1 for none) and the leaf's rank. Leaves stand in the order of their ranks.
@group(3) @binding(1) var<storage, read> stand_leaves: array<array<vec4f, 4>>;
// For each plant the rows from its frame to the world. The last row has the share of its leaves that is drawn, how
// many sections stand before those of its pose, and the factors of the leaves' areas and of the sun's light
// (`far`).
@group(3) @binding(2) var<storage, read> stand_plants: array<array<vec4f, 4>>;

fn plant_of(instance: u32) -> u32 {
    return stand_draw.numbers.y + instance / stand_draw.numbers.x;
}

// The section of a plant, counted in the first pose, in the plant's own pose.
fn in_pose(plant: u32, section: i32) -> i32 {
    return select(section + i32(stand_plants[plant][3].y), -1, section < 0);
}

// The leaf of an instance in its plant's frame, enlarged where fewer are drawn (`thinning::size` and
// `thinning::larger`).
fn leaf_of(instance: u32) -> Standing {
    let leaf = stand_leaves[instance % stand_draw.numbers.x];
    let plant = plant_of(instance);
    let kept = stand_plants[plant][3].x;
    var size = 1.0;
    if (kept < 1.0) {
        let fade = min(f32(FADE_PERCENT) / 100.0 * kept, 1.0 - kept);
        let own = clamp((kept - leaf[3].y) / max(fade, 1e-6), 0.0, 1.0);
        size = sqrt(own * stand_plants[plant][3].z / (kept - 0.5 * fade));
    }
    let middle = stand_draw.middle.xyz;
    return Standing(
        vec4f(size * leaf[0].xyz, leaf[0].w + (1.0 - size) * dot(leaf[0].xyz, middle)),
        vec4f(size * leaf[1].xyz, leaf[1].w + (1.0 - size) * dot(leaf[1].xyz, middle)),
        vec4f(size * leaf[2].xyz, leaf[2].w + (1.0 - size) * dot(leaf[2].xyz, middle)),
        in_pose(plant, i32(leaf[3].x)),
    );
}

// A place in a plant's frame, in the world; and a direction, as long as the plant's scale makes it.
fn on_land(plant: u32, place: vec3f) -> vec3f {
    let rows = stand_plants[plant];
    let p = vec4f(place, 1.0);
    return vec3f(dot(rows[0], p), dot(rows[1], p), dot(rows[2], p));
}

fn turned_on_land(plant: u32, d: vec3f) -> vec3f {
    let rows = stand_plants[plant];
    return vec3f(dot(rows[0].xyz, d), dot(rows[1].xyz, d), dot(rows[2].xyz, d));
}
//#endif
