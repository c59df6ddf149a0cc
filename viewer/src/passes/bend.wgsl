//#if BEND
// Moves what sections carry: the leaves and the bark of plants. A section is a rigid motion: see `rigid.wgsl`.
// `bend.rs` does the same as this file on the CPU. Sections may be stored for more than one time, one time after the
// other. Time 0 is the time that is drawn.

@group(2) @binding(0) var<storage, read> sections: array<array<vec4f, 2>>;

struct Bent {
    position: vec3f,
    normal: vec3f,
    tangent: vec3f,
}

// Moves a place with the section of this number, and with it a normal and a tangent. The place is counted from the
// section's point at rest. Without a section, which is −1, it is a place in world space and stays.
fn bent(section: i32, place: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    return bent_at(0u, section, place, normal, tangent);
}

// The same at one of the times that are stored.
fn bent_at(time: u32, section: i32, place: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    if (section < 0) {
        return Bent(place, normal, tangent);
    }
    let moved = moved_by(u32(section) + time * SECTIONS);
    return Bent(moved.to + rotate(moved.turn, place), rotate(moved.turn, normal), rotate(moved.turn, tangent));
}
//#endif
