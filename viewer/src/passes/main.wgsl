// Radiance of the leaves towards the camera: the formulas of `scene.rs` (Wang et al. 2005, Eq. 1, with a bounded
// gloss). Only what the scene needs is assembled: see `shader.rs`. Textures are looked up in `maps.wgsl`, light is
// taken in `light.wgsl`.

struct Frame {
    view_projection: mat4x4f,
    // The eye and 1, or the direction to a parallel camera and 0.
    eye: vec4f,
    sun_direction: vec4f,
    sun_irradiance: vec4f,
    sky: vec4f,
    // x: side of a shadow texel, y: how far levels of detail may be apart (mm).
    shadow: vec4f,
    // A scanner's tube. x: where it stands along its travel, y: half its length, z: radius, w: height.
    tube: vec4f,
    // x: 1 where it moves along y, y: 1 for gloss with its V-cavity factor.
    travel: vec4f,
}

struct LeafConstants {
    // x: mean thickness h (mm), y: refractive index.
    leaf: vec4f,
    // Slab curves: x thinnest (mm), y points per mm, z last point's index.
    front_curve: vec4f,
    back_curve: vec4f,
    // Albedo tables' rows: x ln of the smallest m, y 1/ln(m_max/m_min).
    albedo: vec4f,
}

@group(0) @binding(0) var<uniform> frame: Frame;
//#if SHADOW
@group(0) @binding(1) var shadow_map: texture_depth_2d_array;
@group(0) @binding(2) var shadow_sampler: sampler_comparison;
@group(0) @binding(3) var<uniform> shadow_matrices: array<mat4x4f, SHADOW_LAYERS>;
//#endif

//#if DOME
// Harmonics of the light from all around, normalisation folded in, at l(l+1)+m.
@group(0) @binding(8) var<uniform> dome: array<vec4f, 49>;
//#endif

@group(1) @binding(0) var<uniform> constants: LeafConstants;
//#if SAMPLED
@group(1) @binding(1) var map_sampler: sampler;
//#endif
//#if FRONT_CURVE
@group(1) @binding(2) var front_curve: texture_2d<f32>;
@group(1) @binding(4) var front_gamma_delta: texture_2d<f32>;
//#endif
//#if BACK_CURVE
@group(1) @binding(3) var back_curve: texture_2d<f32>;
@group(1) @binding(5) var back_gamma_delta: texture_2d<f32>;
//#endif
//#if FRONT_GLOSS
@group(1) @binding(6) var front_gloss: texture_2d<f32>;
//#endif
//#if BACK_GLOSS
@group(1) @binding(7) var back_gloss: texture_2d<f32>;
//#endif
//#if FRONT_NORMAL
@group(1) @binding(8) var front_normal: texture_2d<f32>;
//#endif
//#if BACK_NORMAL
@group(1) @binding(9) var back_normal: texture_2d<f32>;
//#endif
//#if FRONT_MAPS
@group(1) @binding(10) var front_rho_d: texture_2d<f32>;
@group(1) @binding(11) var front_rho_t: texture_2d<f32>;
//#endif
//#if BACK_MAPS
@group(1) @binding(12) var back_rho_d: texture_2d<f32>;
@group(1) @binding(13) var back_rho_t: texture_2d<f32>;
//#endif
//#if MASK
@group(1) @binding(14) var mask: texture_2d<f32>;
//#endif
//#if ALBEDO
@group(1) @binding(15) var albedo_table: texture_2d<f32>;
//#if DOME
@group(1) @binding(16) var lobe_means: texture_2d<f32>;
//#endif
//#endif
// Light that enters a side and comes out of the other, as vectors whose product with the light's direction (or the bent
// one) in the lit side's frame is f (or, a layer a channel, ρt·f).
//#if FRONT_COLOUR
@group(1) @binding(17) var front_translucency: texture_2d_array<f32>;
//#else
//#if FRONT_TRANSLUCENCY
@group(1) @binding(17) var front_translucency: texture_2d<f32>;
//#endif
//#endif
//#if BACK_COLOUR
@group(1) @binding(18) var back_translucency: texture_2d_array<f32>;
//#else
//#if BACK_TRANSLUCENCY
@group(1) @binding(18) var back_translucency: texture_2d<f32>;
//#endif
//#endif

struct Vertex {
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    //#if TANGENT
    @location(2) tangent: vec4f,
    //#endif
    @location(3) uv: vec2f,
    // Rows of the instance's object-to-world matrix.
    @location(4) world_x: vec4f,
    @location(5) world_y: vec4f,
    @location(6) world_z: vec4f,
    //#if BEND
    // Branch and place on it: see `bent`.
    @location(7) ride: vec2f,
    //#endif
}

struct Varying {
    @builtin(position) position: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    //#if TANGENT
    @location(3) tangent: vec4f,
    //#endif
}

struct Pixel {
    @location(0) radiance: vec4f,
    //#if SAMPLE_MASK
    @builtin(sample_mask) samples: u32,
    //#endif
}

fn turned(in: Vertex, d: vec3f) -> vec3f {
    return vec3f(dot(in.world_x.xyz, d), dot(in.world_y.xyz, d), dot(in.world_z.xyz, d));
}

@vertex
fn vertex(in: Vertex) -> Varying {
    let p = vec4f(in.position, 1.0);
    var out: Varying;
    out.world = vec3f(dot(in.world_x, p), dot(in.world_y, p), dot(in.world_z, p));
    // Uniform scale only: normals turn like directions and are normalised in the fragment stage.
    out.normal = turned(in, in.normal);
    out.uv = in.uv;
    //#if TANGENT
    out.tangent = vec4f(turned(in, in.tangent.xyz), in.tangent.w);
    //#endif
    //#if BEND
    //#if TANGENT
    let swung = bent(in.ride, out.world, out.normal, out.tangent.xyz);
    out.tangent = vec4f(swung.tangent, in.tangent.w);
    //#else
    let swung = bent(in.ride, out.world, out.normal, vec3f(0.0));
    //#endif
    out.world = swung.position;
    out.normal = swung.normal;
    //#endif
    out.position = frame.view_projection * vec4f(out.world, 1.0);
    return out;
}

//#if LIT
// How the pixel's point is seen and lit, whatever the maps say there.
struct Facing {
    view: vec3f,
    // The mesh's normal on the viewer's side.
    towards_viewer: vec3f,
    front: bool,
    //#if TANGENT
    axes: Basis,
    //#endif
}

// What one place of the maps sends to the viewer: by the sky's light, and by the sun's before its shadow.
struct Shade {
    ambient: vec3f,
    sunlit: vec3f,
}

//#if SUN
// What comes through of the sun on the far side, times π and per irradiance: max(0, F·l)·ρt, or the translucency maps'
// in place of the cosine (or of both).
fn through(place: Place, facing: Facing, light: vec3f, transmittance: vec3f) -> vec3f {
    //#if FRONT_TRANSLUCENCY || BACK_TRANSLUCENCY
    let axes = facing.axes;
    // In the front's frame; the back's camera looks from behind: x and z change their sign.
    //#if BENT
    // Where the bent functions are looked up: x and y multiplied by (2|z|/(1+|z|))^¼.
    let height = abs(dot(axes.normal, light));
    let bend = sqrt(sqrt(2.0 * height / (1.0 + height)));
    let omega = vec3f(bend * dot(axes.tangent, light), bend * dot(axes.bitangent, light), dot(axes.normal, light));
    //#else
    let omega = vec3f(dot(axes.tangent, light), dot(axes.bitangent, light), dot(axes.normal, light));
    //#endif
    //#endif
    //#if BACK_COLOUR
    if (facing.front) {
        return max(vec3f(0.0), colour_at(back_translucency, place.back, place, vec3f(-omega.x, omega.y, -omega.z)));
    }
    //#else
    //#if BACK_TRANSLUCENCY
    if (facing.front) {
        return max(0.0, dot(at(back_translucency, place.back, place).xyz, vec3f(-omega.x, omega.y, -omega.z))) * transmittance;
    }
    //#endif
    //#endif
    //#if FRONT_COLOUR
    if (!facing.front) {
        return max(vec3f(0.0), colour_at(front_translucency, place.front, place, omega));
    }
    //#else
    //#if FRONT_TRANSLUCENCY
    if (!facing.front) {
        return max(0.0, dot(at(front_translucency, place.front, place).xyz, omega)) * transmittance;
    }
    //#endif
    //#endif
    //#if !FRONT_TRANSLUCENCY || !BACK_TRANSLUCENCY
    //#if TANGENT
    let far = mapped(!facing.front, place, facing.axes);
    //#else
    let far = -facing.towards_viewer;
    //#endif
    return max(0.0, dot(far, light)) * transmittance;
    //#else
    return vec3f(0.0);
    //#endif
}
//#endif

fn shade(place: Place, facing: Facing) -> Shade {
    var out = Shade(vec3f(0.0), vec3f(0.0));
    let view = facing.view;
    // The viewed side's mapped normal N; the far side's F is looked up only where the sun needs it.
    //#if TANGENT
    let viewed = mapped(facing.front, place, facing.axes);
    //#else
    let viewed = facing.towards_viewer;
    //#endif
    //#if GLOSS
    let gloss = viewed_gloss(facing.front, place);
    let roughness = max(gloss.a, 1e-3);
    //#endif
    //#if SKY
    var reflectance: vec3f;
    var transmittance: vec3f;
    if (facing.front) {
        reflectance = front_reflectance(place);
        transmittance = back_transmittance(place);
    } else {
        reflectance = back_reflectance(place);
        transmittance = front_transmittance(place);
    }
    //#if DOME
    //#if TANGENT
    let away = mapped(!facing.front, place, facing.axes);
    //#else
    let away = -facing.towards_viewer;
    //#endif
    out.ambient = reflectance * even_light(viewed) + transmittance * even_light(away);
    //#if ALBEDO
    out.ambient += gloss.rgb * albedo(dot(viewed, view), roughness) * glossy_light(viewed, view, roughness);
    //#endif
    //#else
    var scattered = reflectance + transmittance;
    //#if ALBEDO
    scattered += gloss.rgb * albedo(dot(viewed, view), roughness);
    //#endif
    out.ambient = frame.sky.rgb * scattered;
    //#endif
    //#endif
    //#if SUN
    let light = frame.sun_direction.xyz;
    let cosine = dot(light, facing.towards_viewer);
    if (cosine > 0.0) {
        let nl = max(0.0, dot(viewed, light));
        //#if !SKY
        var reflectance: vec3f;
        if (facing.front) {
            reflectance = front_reflectance(place);
        } else {
            reflectance = back_reflectance(place);
        }
        //#endif
        out.sunlit = nl * reflectance * 0.318309886;
        //#if GLOSS
        out.sunlit += nl * gloss.rgb * lobe(viewed, light, view, roughness);
        //#endif
    } else if (cosine < 0.0) {
        //#if !SKY
        let transmittance = far_transmittance(place, facing.front);
        //#endif
        out.sunlit = through(place, facing, light, transmittance) * 0.318309886;
    }
    //#endif
    return out;
}

//#if SCANNER
const TUBE_NODES: i32 = 160;

// Radiance under the tube: midpoints along it, four Gauss points across it.
fn scanned(place: Place, facing: Facing, world: vec3f) -> vec3f {
    //#if TANGENT
    let normal = mapped(facing.front, place, facing.axes);
    //#else
    let normal = facing.towards_viewer;
    //#endif
    var reflectance: vec3f;
    if (facing.front) {
        reflectance = front_reflectance(place);
    } else {
        reflectance = back_reflectance(place);
    }
    //#if GLOSS
    let gloss = viewed_gloss(facing.front, place);
    let roughness = max(gloss.a, 1e-3);
    //#endif
    // Along the travel, along the tube.
    let turned = frame.travel.x > 0.5;
    let own = select(world.xy, world.yx, turned);
    let away = frame.tube.x - own.x;
    let distance = length(vec2f(away, frame.tube.w));
    let theta = atan2(away, frame.tube.w);
    let beta = asin(min(frame.tube.z / distance, 1.0));
    let low = atan((-frame.tube.y - own.y) / distance);
    let high = atan((frame.tube.y - own.y) / distance);
    var across = array<vec2f, 4>(
        vec2f(-0.861136312, 0.347854845), vec2f(-0.339981044, 0.652145155), vec2f(0.339981044, 0.652145155), vec2f(0.861136312, 0.347854845));
    var sum = vec3f(0.0);
    for (var i = 0; i < TUBE_NODES; i++) {
        let phi = mix(low, high, (f32(i) + 0.5) / f32(TUBE_NODES));
        let c = cos(phi);
        let s = sin(phi);
        for (var k = 0; k < 4; k++) {
            let t = theta + beta * across[k].x;
            let local = vec3f(sin(t) * c, s, cos(t) * c);
            let light = select(local, local.yxz, turned);
            let nl = dot(normal, light);
            if (nl > 0.0) {
                var f = reflectance * 0.318309886;
                //#if GLOSS
                f += gloss.rgb * lobe(normal, light, facing.view, roughness);
                //#endif
                sum += across[k].y * c * nl * f;
            }
        }
    }
    let spread = select(1.0 / distance, beta / max(frame.tube.z, 1e-6), frame.tube.z > 0.0);
    return sum * (spread * frame.tube.w * (high - low) / f32(TUBE_NODES));
}
//#endif

//#if SUPERSAMPLE
// The place moved by a part of a pixel, its footprint a third as wide.
fn moved(place: Place, by: vec2f) -> Place {
    let shift = place.dx * by.x + place.dy * by.y;
    return Place(place.front + shift, place.back + vec2f(-shift.x, shift.y), place.dx * 0.35, place.dy * 0.35);
}

// Whether the normal turns by more than a fifth of the lobe's slope across the pixel: there the mean normal's highlight
// is not the highlights' mean (its error grows with the square: a fifth leaves 0.3 %).
fn uneven(place: Place, facing: Facing) -> bool {
    let here = mapped(facing.front, place, facing.axes);
    let slope = max(viewed_gloss(facing.front, place).a, 1e-3);
    var turn = 0.0;
    for (var i = 0; i < 4; i++) {
        let by = select(vec2f(0.0, f32(i) - 2.5), vec2f(f32(i) - 0.5, 0.0), i < 2);
        let d = mapped(facing.front, moved(place, by), facing.axes) - here;
        turn = max(turn, dot(d, d));
    }
    return 4.0 * turn > 0.04 * slope * slope;
}
//#endif
//#endif

@fragment
fn fragment(in: Varying) -> Pixel {
    var out: Pixel;
    let dx = dpdx(in.uv);
    let dy = dpdy(in.uv);
    //#if MASK
    //#if SAMPLE_MASK
    // The standard four sample positions, in pixels from the centre: coverage as four rays would find it.
    var samples = 0u;
    var offsets = array<vec2f, 4>(vec2f(-0.125, -0.375), vec2f(0.375, -0.125), vec2f(-0.375, 0.125), vec2f(0.125, 0.375));
    for (var i = 0u; i < 4u; i++) {
        let uv = in.uv + dx * offsets[i].x + dy * offsets[i].y;
        if (textureSampleLevel(mask, map_sampler, uv, 0.0).r >= 0.5) {
            samples |= 1u << i;
        }
    }
    out.samples = samples;
    if (samples == 0u) {
        discard;
    }
    //#else
    if (textureSampleLevel(mask, map_sampler, in.uv, 0.0).r < 0.5) {
        discard;
    }
    //#endif
    //#endif
    var radiance = vec3f(0.0);
    //#if LIT
    let place = Place(in.uv, vec2f(1.0 - in.uv.x, in.uv.y), dx, dy);
    let view = normalize(frame.eye.xyz - frame.eye.w * in.world);
    let mesh_normal = normalize(in.normal);
    let front = dot(mesh_normal, view) >= 0.0;
    let towards_viewer = select(-mesh_normal, mesh_normal, front);
    //#if TANGENT
    let facing = Facing(view, towards_viewer, front, basis(in, mesh_normal));
    //#else
    let facing = Facing(view, towards_viewer, front);
    //#endif
    var seen: Shade;
    //#if SUPERSAMPLE
    if (dot(frame.sun_direction.xyz, towards_viewer) > 0.0 && uneven(place, facing)) {
        // Eight places that share no row, column or diagonal.
        var spots = array<vec2f, 8>(
            vec2f(0.0625, -0.1875), vec2f(-0.0625, 0.1875), vec2f(0.3125, 0.0625), vec2f(-0.1875, -0.3125),
            vec2f(-0.3125, 0.3125), vec2f(-0.4375, -0.0625), vec2f(0.1875, 0.4375), vec2f(0.4375, -0.4375));
        for (var i = 0; i < 8; i++) {
            let one = shade(moved(place, spots[i]), facing);
            seen = Shade(seen.ambient + 0.125 * one.ambient, seen.sunlit + 0.125 * one.sunlit);
        }
    } else {
        seen = shade(place, facing);
    }
    //#else
    seen = shade(place, facing);
    //#endif
    radiance += seen.ambient;
    //#if SCANNER
    radiance += scanned(place, facing, in.world);
    //#endif
    //#if SUN
    var sunlit = seen.sunlit;
    //#if SHADOW
    if (max(sunlit.r, max(sunlit.g, sunlit.b)) > 0.0) {
        let cosine = dot(frame.sun_direction.xyz, towards_viewer);
        sunlit *= visibility(in.world, select(-towards_viewer, towards_viewer, cosine > 0.0), abs(cosine));
    }
    //#endif
    radiance += frame.sun_irradiance.rgb * sunlit;
    //#endif
    //#endif
    // A 16-bit target holds 65504 at most, and one overflow would blacken the picture after x/(1 + x).
    out.radiance = vec4f(min(radiance, vec3f(6e4)), 1.0);
    return out;
}
