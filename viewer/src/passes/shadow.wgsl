// Depth along one direction of the sun's disk, in an orthographic projection.

@group(0) @binding(0) var<uniform> to_light: mat4x4f;
struct Varying {
    @builtin(position) position: vec4f,
    //#if MASK
    @location(0) uv: vec2f,
    //#endif
}

@vertex
fn vertex(in: Vertex) -> Varying {
    var out: Varying;
    out.position = to_light * vec4f(stands_at(0u, in), 1.0);
    //#if MASK
    out.uv = in.uv;
    //#endif
    return out;
}

//#if MASK
@fragment
fn fragment(in: Varying) {
    if (is_cut_off(in.uv)) {
        discard;
    }
}
//#endif
