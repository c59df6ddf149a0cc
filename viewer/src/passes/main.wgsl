// Radiance of the leaves towards the camera: the formulas of `scene.rs` (Wang et al. 2005, Eq. 1, with a bounded gloss).
// Only what the scene needs is assembled: see `shader.rs`.

struct Frame {
    view_projection: mat4x4f,
    eye: vec4f,
    sun_direction: vec4f,
    sun_irradiance: vec4f,
    sky: vec4f,
    // x: side of a shadow texel in mm.
    shadow: vec4f,
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
// Light that enters a side and comes out of the other, as vectors whose product with the light's direction in the lit side's frame is f (or,
// a layer a channel, ρt·f).
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
// Where a fragment lies on both sides' maps, with screen derivatives for the choice of mip.
struct Place {
    front: vec2f,
    back: vec2f,
    dx: vec2f,
    dy: vec2f,
}

// The map's mean over the pixel: up to 16 trilinear samples along the longer axis of the pixel's footprint, each as wide as the shorter
// one, so that a blade seen at a slant is not blurred along its veins. Samplers' own anisotropic filters blur magnified maps too on some
// adapters (Mesa's software one); here a footprint of less than a texel is one plain bilinear sample everywhere.
fn at(map: texture_2d<f32>, uv: vec2f, place: Place) -> vec4f {
    let print = footprint(vec2f(textureDimensions(map)), place);
    var sum = vec4f(0.0);
    for (var i = 0.0; i < print.steps; i += 1.0) {
        sum += textureSampleLevel(map, map_sampler, uv + print.axis * ((i + 0.5) / print.steps - 0.5), print.lod);
    }
    return sum / print.steps;
}

struct Footprint {
    axis: vec2f,
    steps: f32,
    lod: f32,
}

fn footprint(size: vec2f, place: Place) -> Footprint {
    let across = length(place.dx * size);
    let down = length(place.dy * size);
    let longer = max(across, down);
    let shorter = max(min(across, down), 1.0);
    let steps = clamp(ceil(longer / shorter - 0.01), 1.0, 16.0);
    let lod = log2(max(max(longer / steps, shorter), 1.0));
    return Footprint(select(place.dy, place.dx, across >= down), steps, lod);
}

//#if COLOUR
// As `at`, of three layers: the product of each one's mean with a direction.
fn colour_at(map: texture_2d_array<f32>, uv: vec2f, place: Place, direction: vec3f) -> vec3f {
    let print = footprint(vec2f(textureDimensions(map)), place);
    var sum = vec3f(0.0);
    for (var i = 0.0; i < print.steps; i += 1.0) {
        let here = uv + print.axis * ((i + 0.5) / print.steps - 0.5);
        for (var c = 0; c < 3; c++) {
            sum[c] += dot(textureSampleLevel(map, map_sampler, here, c, print.lod).xyz, direction);
        }
    }
    return sum / print.steps;
}
//#endif

//#if FRONT_CURVE || BACK_CURVE
// ρd (row 0) or ρt (row 1) of the slab at a thickness, linear between the curve's points.
fn slab(curve: texture_2d<f32>, range: vec4f, thickness: f32, row: i32) -> vec3f {
    let x = clamp((thickness - range.x) * range.y, 0.0, range.z);
    let i = min(i32(x), i32(range.z) - 1);
    return mix(textureLoad(curve, vec2i(i, row), 0).rgb, textureLoad(curve, vec2i(i + 1, row), 0).rgb, x - f32(i));
}
//#endif

fn front_reflectance(place: Place) -> vec3f {
    //#if FRONT_CURVE
    let gamma_delta = at(front_gamma_delta, place.front, place);
    return gamma_delta.rgb * slab(front_curve, constants.front_curve, constants.leaf.x + gamma_delta.a, 0);
    //#else
    //#if FRONT_MAPS
    return at(front_rho_d, place.front, place).rgb;
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}

fn back_reflectance(place: Place) -> vec3f {
    //#if BACK_CURVE
    let gamma_delta = at(back_gamma_delta, place.back, place);
    return gamma_delta.rgb * slab(back_curve, constants.back_curve, constants.leaf.x + gamma_delta.a, 0);
    //#else
    //#if BACK_MAPS
    return at(back_rho_d, place.back, place).rgb;
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}

fn front_transmittance(place: Place) -> vec3f {
    //#if FRONT_CURVE
    return slab(front_curve, constants.front_curve, constants.leaf.x + at(front_gamma_delta, place.front, place).a, 1);
    //#else
    //#if FRONT_MAPS
    return at(front_rho_t, place.front, place).rgb;
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}

fn back_transmittance(place: Place) -> vec3f {
    //#if BACK_CURVE
    return slab(back_curve, constants.back_curve, constants.leaf.x + at(back_gamma_delta, place.back, place).a, 1);
    //#else
    //#if BACK_MAPS
    return at(back_rho_t, place.back, place).rgb;
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}
//#endif

//#if TANGENT
struct Basis {
    tangent: vec3f,
    bitangent: vec3f,
    normal: vec3f,
}

fn basis(in: Varying, normal: vec3f) -> Basis {
    let tangent = normalize(in.tangent.xyz - normal * dot(normal, in.tangent.xyz));
    return Basis(tangent, in.tangent.w * cross(normal, tangent), normal);
}

// A side's mapped normal, outward from that side.
fn mapped(front: bool, place: Place, axes: Basis) -> vec3f {
    if (front) {
        //#if FRONT_NORMAL
        let n = at(front_normal, place.front, place).xyz;
        return normalize(n.x * axes.tangent + n.y * axes.bitangent + n.z * axes.normal);
        //#else
        return axes.normal;
        //#endif
    }
    //#if BACK_NORMAL
    // The back's camera looks from behind: its right is against the tangent, its up along the bitangent, its z against the normal.
    let n = at(back_normal, place.back, place).xyz;
    return normalize(-n.x * axes.tangent + n.y * axes.bitangent - n.z * axes.normal);
    //#else
    return -axes.normal;
    //#endif
}
//#endif

//#if GLOSS
fn viewed_gloss(front: bool, place: Place) -> vec4f {
    //#if FRONT_GLOSS
    if (front) {
        return at(front_gloss, place.front, place);
    }
    //#endif
    //#if BACK_GLOSS
    if (!front) {
        return at(back_gloss, place.back, place);
    }
    //#endif
    return vec4f(0.0, 0.0, 0.0, 1.0);
}
//#endif

//#if SUN
//#if GLOSS
// f_s per unit ρs; 0 where the half vector lies below the surface.
fn lobe(normal: vec3f, light: vec3f, view: vec3f, roughness: f32) -> f32 {
    let h = normalize(light + view);
    let nh = dot(normal, h);
    let nl = dot(normal, light);
    let nv = max(dot(normal, view), 1e-3);
    let vh = dot(view, h);
    if (nh <= 0.0 || nl <= 0.0 || vh <= 0.0) {
        return 0.0;
    }
    let m2 = roughness * roughness;
    // sin²α from the cross product: 1 − cos²α would lose its digits near the mirror direction.
    let across = cross(normal, h);
    let cos2 = nh * nh;
    let tan2 = dot(across, across) / cos2;
    //#if GGX
    let density = m2 / (3.14159265 * cos2 * cos2 * (m2 + tan2) * (m2 + tan2));
    //#else
    let density = exp(-tan2 / m2) / (3.14159265 * m2 * cos2 * cos2);
    //#endif
    let cavity = min(1.0, 2.0 * nh * min(nv, nl) / vh);
    var f = density * cavity / (4.0 * nl * nv);
    //#if FRESNEL
    let n = constants.leaf.y;
    let t = sqrt(1.0 - (1.0 - min(vh, 1.0) * min(vh, 1.0)) / (n * n));
    let s_wave = (vh - n * t) / (vh + n * t);
    let p_wave = (n * vh - t) / (n * vh + t);
    f *= 0.5 * (s_wave * s_wave + p_wave * p_wave);
    //#endif
    return f;
}
//#endif

//#if SHADOW
// Share of the sun's disk that is seen from a point: the mean over the shadow maps, each a 2×2 comparison. The point is lifted off its
// surface by as much as the depth can change within the filter's reach, so that a leaf does not shadow itself.
fn visibility(world: vec3f, normal_to_sun: vec3f, cosine: f32) -> f32 {
    let sine = sqrt(max(0.0, 1.0 - cosine * cosine));
    let lifted = vec4f(world + normal_to_sun * (frame.shadow.x * (0.3 + 2.0 * sine)), 1.0);
    var seen = 0.0;
    for (var i = 0u; i < SHADOW_LAYERS; i++) {
        let p = (shadow_matrices[i] * lifted).xyz;
        seen += textureSampleCompareLevel(shadow_map, shadow_sampler, vec2f(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y), i, p.z);
    }
    return seen / f32(SHADOW_LAYERS);
}
//#endif
//#endif

//#if ALBEDO
// a(N·v, m): bilinear in √(N·v) and ln m.
fn albedo(nv: f32, roughness: f32) -> f32 {
    let size = vec2f(textureDimensions(albedo_table));
    let first = sqrt(1e-3);
    let x = (sqrt(clamp(nv, 1e-3, 1.0)) - first) / (1.0 - first);
    let y = clamp((log(roughness) - constants.albedo.x) * constants.albedo.y, 0.0, 1.0);
    let p = vec2f(x, y) * (size - 1.0);
    let i = min(vec2i(p), vec2i(size) - 2);
    let t = p - vec2f(i);
    let low = mix(textureLoad(albedo_table, i, 0).r, textureLoad(albedo_table, i + vec2i(1, 0), 0).r, t.x);
    let high = mix(textureLoad(albedo_table, i + vec2i(0, 1), 0).r, textureLoad(albedo_table, i + vec2i(1, 1), 0).r, t.x);
    return mix(low, high, t.y);
}
//#endif

//#if DOME
// Σ w_l c_lm Y_lm(d), not below 0: p_mm = 1, (l−m) p_l = (2l−1) z p_{l−1} − (l+m−1) p_{l−2}, times the parts of (x + iy)^m.
fn gathered(d: vec3f, weight: array<f32, 7>) -> vec3f {
    var w = weight;
    var sum = vec3f(0.0);
    var turn = vec2f(1.0, 0.0);
    for (var m = 0; m < 7; m++) {
        var before = 0.0;
        var p = 1.0;
        for (var l = m; l < 7; l++) {
            let at = l * (l + 1);
            var part = turn.x * dome[at + m].rgb;
            if (m > 0) {
                part += turn.y * dome[at - m].rgb;
            }
            sum += w[l] * p * part;
            let next = (f32(2 * l + 1) * d.z * p - f32(l + m) * before) / f32(l + 1 - m);
            before = p;
            p = next;
        }
        turn = vec2f(turn.x * d.x - turn.y * d.y, turn.x * d.y + turn.y * d.x);
    }
    return max(sum, vec3f(0.0));
}

// Irradiance over π on a surface with this normal: the cosine lobe's bands are 1, 2/3, 1/4, 0, −1/24, 0, 1/64 of π.
fn even_light(normal: vec3f) -> vec3f {
    return gathered(normal, array<f32, 7>(1.0, 2.0 / 3.0, 0.25, 0.0, -1.0 / 24.0, 0.0, 1.0 / 64.0));
}

//#if ALBEDO
fn means(place: vec2f, row: f32) -> vec4f {
    let i = min(vec2i(place), vec2i(94, 22));
    let t = place - vec2f(i);
    let j = i + vec2i(0, i32(row));
    let low = mix(textureLoad(lobe_means, j, 0), textureLoad(lobe_means, j + vec2i(1, 0), 0), t.x);
    let high = mix(textureLoad(lobe_means, j + vec2i(0, 1), 0), textureLoad(lobe_means, j + vec2i(1, 1), 0), t.x);
    return mix(low, high, t.y);
}

// Mean radiance that the lobe collects: its bands about its mean direction.
fn glossy_light(normal: vec3f, view: vec3f, roughness: f32) -> vec3f {
    let nv = dot(normal, view);
    let first = sqrt(1e-3);
    let x = (sqrt(clamp(nv, 1e-3, 1.0)) - first) / (1.0 - first);
    let y = clamp((log(roughness) - constants.albedo.x) * constants.albedo.y, 0.0, 1.0);
    let place = vec2f(x * 95.0, y * 23.0);
    let a = means(place, 0.0);
    let b = means(place, 24.0);
    let along = nv * normal - view;
    let direction = normalize(a.x * along + a.y * normal);
    return gathered(direction, array<f32, 7>(1.0, a.z, a.w, b.x, b.y, b.z, b.w));
}
//#endif
//#endif

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
//#if !SKY
// ρt of a beam that enters the far side, where it takes part.
fn far_transmittance(place: Place, front: bool) -> vec3f {
    if (front) {
        //#if BACK_COLOUR
        return vec3f(0.0);
        //#else
        return back_transmittance(place);
        //#endif
    }
    //#if FRONT_COLOUR
    return vec3f(0.0);
    //#else
    return front_transmittance(place);
    //#endif
}
//#endif

// What comes through of the sun on the far side, times π and per irradiance: max(0, F·l)·ρt, or the translucency maps' in place of the
// cosine (or of both).
fn through(place: Place, facing: Facing, light: vec3f, transmittance: vec3f) -> vec3f {
    //#if FRONT_TRANSLUCENCY || BACK_TRANSLUCENCY
    let axes = facing.axes;
    // In the front's frame; the back's camera looks from behind: x and z change their sign.
    let omega = vec3f(dot(axes.tangent, light), dot(axes.bitangent, light), dot(axes.normal, light));
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

//#if SUPERSAMPLE
// The place moved by a part of a pixel, its footprint a third as wide.
fn moved(place: Place, by: vec2f) -> Place {
    let shift = place.dx * by.x + place.dy * by.y;
    return Place(place.front + shift, place.back + vec2f(-shift.x, shift.y), place.dx * 0.35, place.dy * 0.35);
}

// Whether the normal turns by more than a fifth of the lobe's slope across the pixel: there the mean normal's highlight is not the
// highlights' mean (its error grows with the square: a fifth leaves 0.3 %).
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
    let view = normalize(frame.eye.xyz - in.world);
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
