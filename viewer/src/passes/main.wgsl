// Radiance of a surface towards the camera, by the formulas of `scene.rs` (Wang et al. 2005, Eq. 1, with a bounded
// gloss). This is the part that all materials share; `leaf.wgsl` or `opaque.wgsl` follows it. Only the parts that the
// scene needs are assembled: see `shader.rs`. Lights are in `light.wgsl`. Textures are read in `maps.wgsl` and, for
// each side, in `side.wgsl`.

struct Frame {
    view_projection: mat4x4f,
    // The eye and 1, or the direction to a parallel camera and 0.
    eye: vec4f,
    sun_direction: vec4f,
    sun_irradiance: vec4f,
    sky: vec4f,
    // x: side of a shadow texel, y: the largest distance between levels of detail (mm). z: the share of the side of the
    // maps' texture up to which it holds the maps.
    shadow: vec4f,
    // A scanner's tube. x: its place along its travel, y: half its length, z: its radius, w: its height.
    tube: vec4f,
    // x: 1 where the tube moves along y. y: 1 for gloss with its V-cavity factor.
    travel: vec4f,
}

@group(0) @binding(0) var<uniform> frame: Frame;
//#if SHADOW
@group(0) @binding(1) var shadow_map: texture_depth_2d_array;
@group(0) @binding(2) var shadow_sampler: sampler_comparison;
@group(0) @binding(3) var<uniform> shadow_matrices: array<mat4x4f, SHADOW_LAYERS>;
//#endif

//#if TRANSFER
// Light that arrives at the anchors: see `transfer.wgsl`.
@group(0) @binding(9) var<storage, read> arriving: array<vec4f>;
//#else
//#if DOME
// Harmonics of the light from all around, at l(l+1)+m. They contain their normalisation.
@group(0) @binding(8) var<uniform> dome: array<vec4f, 49>;
//#endif
//#endif

//#if SHARES
// 255 times the share of the sun's disk that each vertex sees, four to a word.
@group(0) @binding(10) var<storage, read> sun_shares: array<u32>;
//#endif

struct Vertex {
    //#if OWN
    // From the point of the section that carries the vertex, in the scene's axes, with the section's number.
    @location(0) position: vec4f,
    //#else
    @location(0) position: vec3f,
    //#endif
    @location(1) normal: vec3f,
    //#if TANGENT
    @location(2) tangent: vec4f,
    //#endif
    //#if LEAF
    @location(3) uv: vec2f,
    //#endif
    //#if STAND
    @builtin(instance_index) instance: u32,
    //#else
    //#if !OWN
    // Rows of the instance's object-to-world matrix. With `ride`, from the point of the section that carries it.
    @location(4) world_x: vec4f,
    @location(5) world_y: vec4f,
    @location(6) world_z: vec4f,
    //#if BEND
    // That section, or −1.
    @location(7) ride: i32,
    //#endif
    //#endif
    //#endif
    //#if TRANSFER || SHARES
    // First row of the light that arrives at the instance, and index of its first vertex's share of the sun.
    @location(9) begin: vec2u,
    //#endif
    //#if SHARES
    @builtin(vertex_index) number: u32,
    //#endif
    //#if TRANSFER
    // First anchor of the vertex's piece, and the place among the piece's anchors.
    @location(8) place: vec3f,
    //#endif
}

struct Varying {
    @builtin(position) position: vec4f,
    //#if STAND
    // Leaves of far plants are smaller than a pixel, whose centre then lies beside them. They are lit where they are.
    // What is interpolated there may be rounded by a thousand times as much as anywhere else. So places are counted
    // from the leaf's own.
    @location(0) @interpolate(perspective, centroid) beside: vec3f,
    @location(8) @interpolate(flat) own: vec3f,
    @location(1) @interpolate(perspective, centroid) normal: vec3f,
    //#else
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    //#endif
    //#if LEAF
    @location(2) uv: vec2f,
    //#endif
    //#if TANGENT
    @location(3) tangent: vec4f,
    //#endif
    //#if TRANSFER
    //#if LEAF
    // Place among the anchors. `first` is the first row of the instance with the level of its anchors, and the piece's
    // number.
    @location(4) place: vec2f,
    @location(5) @interpolate(flat) first: vec2u,
    //#else
    // Irradiance that arrives at the vertex.
    @location(4) arrived: vec3f,
    //#endif
    //#endif
    //#if SHARES
    // Share of the sun's disk that is seen.
    @location(6) share: f32,
    //#endif
    //#if STAND
    // The factor of the sun's light (`far`).
    @location(7) @interpolate(flat) lit: f32,
    //#endif
}

// The place in the world.
fn world_of(in: Varying) -> vec3f {
    //#if STAND
    return in.own + in.beside;
    //#else
    return in.world;
    //#endif
}

// Where the vertex's instance stands; what sections carry vertex by vertex has no rows.
fn standing(in: Vertex) -> Standing {
    //#if OWN
    //#if STAND
    let ride = in_pose(plant_of(in.instance), i32(in.position.w));
    //#else
    let ride = i32(in.position.w);
    //#endif
    return Standing(vec4f(1.0, 0.0, 0.0, 0.0), vec4f(0.0, 1.0, 0.0, 0.0), vec4f(0.0, 0.0, 1.0, 0.0), ride);
    //#else
    //#if STAND
    return leaf_of(in.instance);
    //#else
    //#if BEND
    return Standing(in.world_x, in.world_y, in.world_z, in.ride);
    //#else
    return Standing(in.world_x, in.world_y, in.world_z, -1);
    //#endif
    //#endif
    //#endif
}

fn turned(at: Standing, d: vec3f) -> vec3f {
    //#if OWN
    return d;
    //#else
    return vec3f(dot(at.x.xyz, d), dot(at.y.xyz, d), dot(at.z.xyz, d));
    //#endif
}

@vertex
fn vertex(in: Vertex) -> Varying {
    var out: Varying;
    let at = standing(in);
    //#if OWN
    var world = in.position.xyz;
    //#else
    let p = vec4f(in.position, 1.0);
    var world = vec3f(dot(at.x, p), dot(at.y, p), dot(at.z, p));
    //#endif
    // The scale is uniform. So normals turn like directions; the fragment stage normalises them.
    out.normal = turned(at, in.normal);
    //#if LEAF
    out.uv = in.uv;
    //#endif
    //#if TANGENT
    out.tangent = vec4f(turned(at, in.tangent.xyz), in.tangent.w);
    //#endif
    //#if BEND
    //#if TANGENT
    let swung = bent(at.ride, world, out.normal, out.tangent.xyz);
    //#else
    let swung = bent(at.ride, world, out.normal, vec3f(0.0));
    //#endif
    world = swung.position;
    //#if TURN
    out.normal = swung.normal;
    //#if TANGENT
    out.tangent = vec4f(swung.tangent, in.tangent.w);
    //#endif
    //#endif
    //#endif
    //#if STAND
    let plant = plant_of(in.instance);
    world = on_land(plant, world);
    out.own = on_land(plant, vec3f(at.x.w, at.y.w, at.z.w));
    out.beside = world - out.own;
    out.normal = turned_on_land(plant, out.normal);
    out.lit = stand_plants[plant][3].w;
    //#if TANGENT
    out.tangent = vec4f(turned_on_land(plant, out.tangent.xyz), in.tangent.w);
    //#endif
    //#endif
    //#if !STAND
    out.world = world;
    //#endif
    //#if TRANSFER
    //#if LEAF
    out.place = in.place.yz;
    out.first = vec2u(in.begin.x, u32(in.place.x) / (GRID_X * GRID_Y));
    //#else
    out.arrived = arriving[in.begin.x + u32(in.place.x) * ROWS].rgb;
    //#endif
    //#endif
    //#if SHARES
    let number = in.begin.y + in.number;
    out.share = f32((sun_shares[number >> 2u] >> (8u * (number & 3u))) & 255u) / 255.0;
    //#endif
    out.position = frame.view_projection * vec4f(world, 1.0);
    return out;
}

// A 16-bit target holds at most 65504. A single overflow would become black after x/(1 + x).
fn held(radiance: vec3f) -> vec4f {
    return vec4f(min(radiance, vec3f(6e4)), 1.0);
}

//#if LIT
// The geometry of the pixel's point towards viewer and light, independent of the maps.
struct Facing {
    view: vec3f,
    // The mesh's normal on the viewer's side.
    towards_viewer: vec3f,
    // The normal that decides on which side light falls, also turned towards the viewer.
    flat_normal: vec3f,
    front: bool,
    //#if SHARES
    share: f32,
    //#endif
    //#if STAND
    lit: f32,
    //#endif
    //#if TANGENT
    axes: Basis,
    //#endif
}

fn faced(in: Varying, front_facing: bool, across: vec3f) -> Facing {
    let view = normalize(frame.eye.xyz - frame.eye.w * world_of(in));
    //#if TRANSFER
    // `across` is a normal of the triangle, on either of its sides. The triangle decides which side is seen and lit, as
    // in the path tracer: where light goes from leaf to leaf, none may pass through a blade unnoticed. An interpolated
    // normal that points the other way is reversed.
    let front = front_facing;
    let flat_normal = normalize(select(-across, across, dot(across, view) > 0.0));
    let outward = select(-flat_normal, flat_normal, front);
    let smooth_normal = normalize(in.normal);
    let mesh_normal = select(-smooth_normal, smooth_normal, dot(smooth_normal, outward) >= 0.0);
    let towards_viewer = select(-mesh_normal, mesh_normal, front);
    //#else
    let mesh_normal = normalize(in.normal);
    let front = dot(mesh_normal, view) >= 0.0;
    let towards_viewer = select(-mesh_normal, mesh_normal, front);
    let flat_normal = towards_viewer;
    //#endif
    var facing: Facing;
    facing.view = view;
    facing.towards_viewer = towards_viewer;
    facing.flat_normal = flat_normal;
    facing.front = front;
    //#if SHARES
    facing.share = in.share;
    //#endif
    //#if STAND
    facing.lit = in.lit;
    //#endif
    //#if TANGENT
    facing.axes = basis(in, mesh_normal);
    //#endif
    return facing;
}

//#if SUN
// The sun's irradiance across its rays, as far as its disk is seen from the point.
fn sunlight(facing: Facing, world: vec3f) -> vec3f {
    var seen = 1.0;
    //#if SHARES
    seen = facing.share;
    //#endif
    //#if SHADOW
    let cosine = dot(frame.sun_direction.xyz, facing.flat_normal);
    seen = visibility(world, select(-facing.flat_normal, facing.flat_normal, cosine > 0.0), abs(cosine));
    //#endif
    //#if STAND
    seen *= facing.lit;
    //#endif
    return seen * frame.sun_irradiance.rgb;
}
//#endif
//#endif
