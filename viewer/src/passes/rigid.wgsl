//#if BEND
// Rigid motions. The shader that follows has them as `sections`: two rows for each, the place that the section's point
// moves to, and a quaternion.

struct Rigid {
    to: vec3f,
    turn: vec4f,
}

fn rotate(q: vec4f, v: vec3f) -> vec3f {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

// The section of this number.
fn moved_by(number: u32) -> Rigid {
    return Rigid(sections[number][0].xyz, sections[number][1]);
}

// The three rows of an instance's transform.
struct Rows {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

// The rows of an instance as the section of this number moves it; at rest they are counted from the section's point.
// Without a section, which is −1, they stay. Columns turn like directions.
fn moved_rows(section: i32, rows: Rows) -> Rows {
    if (section < 0) {
        return rows;
    }
    let by = moved_by(u32(section));
    let first = rotate(by.turn, vec3f(rows.x.x, rows.y.x, rows.z.x));
    let second = rotate(by.turn, vec3f(rows.x.y, rows.y.y, rows.z.y));
    let third = rotate(by.turn, vec3f(rows.x.z, rows.y.z, rows.z.z));
    let origin = by.to + rotate(by.turn, vec3f(rows.x.w, rows.y.w, rows.z.w));
    return Rows(vec4f(first.x, second.x, third.x, origin.x), vec4f(first.y, second.y, third.y, origin.y),
        vec4f(first.z, second.z, third.z, origin.z));
}
//#endif
