// Reads a leaf's maps at a place: reflectance, transmittance, mapped normal and gloss of a side, filtered over the
// pixel. It is part of the main pass. The textures are declared in `side.wgsl`.

//#if LIT
// The place of a fragment on both sides' maps, with screen derivatives that determine the mip level.
struct Place {
    front: vec2f,
    back: vec2f,
    dx: vec2f,
    dy: vec2f,
}

// The mean of the map over the pixel. Up to 16 trilinear samples lie along the longer axis of the pixel's footprint,
// each as wide as the shorter axis. So a blade that is seen at a slant is not blurred along its veins. The anisotropic
// filters of samplers also blur magnified maps on some adapters (Mesa's software adapter is one). Here, a footprint of
// less than a texel is one bilinear sample on every adapter. `mirror` is (1, 1) for the front's map and (-1, 1) for the
// back's: u runs the other way there, and so does the footprint's axis.
fn at(map: texture_2d<f32>, uv: vec2f, mirror: vec2f, place: Place) -> vec4f {
    let print = footprint(vec2f(textureDimensions(map)), mirror, place);
    var sum = vec4f(0.0);
    // There is at least one sample, so the end is asked last. Asked first, adapters that run many pixels in step go
    // through one sample more.
    var i = 0.0;
    loop {
        sum += textureSampleLevel(map, map_sampler, uv + print.axis * ((i + 0.5) / print.steps - 0.5), print.lod);
        i += 1.0;
        if (i >= print.steps) {
            break;
        }
    }
    return sum / print.steps;
}

struct Footprint {
    axis: vec2f,
    steps: f32,
    lod: f32,
}

fn footprint(size: vec2f, mirror: vec2f, place: Place) -> Footprint {
    let across = length(place.dx * size);
    let down = length(place.dy * size);
    let longer = max(across, down);
    let shorter = max(min(across, down), 1.0);
    let steps = clamp(ceil(longer / shorter - 0.01), 1.0, 16.0);
    let lod = log2(max(max(longer / steps, shorter), 1.0));
    let axis = mirror * select(place.dy, place.dx, across >= down);
    return Footprint(axis, steps, lod);
}

// The level of a map from which one of eight spots of a pixel is read: a spot is a third as wide as the pixel, or an
// eighth as long where that is more. The spots are averaged, so each may be read from one level instead of between two.
fn spot_level(size: vec2f, place: Place) -> f32 {
    let across = length(place.dx * size);
    let down = length(place.dy * size);
    return floor(0.5 + log2(max(max(0.125 * max(across, down), 0.35 * min(across, down)), 1.0)));
}

//#if COLOUR
// As `at`, for three layers. Each channel is the product of one layer's mean with a direction.
fn colour_at(map: texture_2d_array<f32>, uv: vec2f, mirror: vec2f, place: Place, direction: vec3f) -> vec3f {
    let print = footprint(vec2f(textureDimensions(map)), mirror, place);
    var sum = vec3f(0.0);
    var i = 0.0;
    loop {
        let here = uv + print.axis * ((i + 0.5) / print.steps - 0.5);
        sum += vec3f(
            dot(textureSampleLevel(map, map_sampler, here, 0, print.lod).xyz, direction),
            dot(textureSampleLevel(map, map_sampler, here, 1, print.lod).xyz, direction),
            dot(textureSampleLevel(map, map_sampler, here, 2, print.lod).xyz, direction));
        i += 1.0;
        if (i >= print.steps) {
            break;
        }
    }
    return sum / print.steps;
}
//#endif

//#if CURVE
// ρd (row 0) or ρt (row 1) of the slab at a thickness, linear between the curve's points.
fn slab(curve: texture_2d<f32>, range: vec4f, thickness: f32, row: i32) -> vec3f {
    let x = clamp((thickness - range.x) * range.y, 0.0, range.z);
    let i = min(i32(x), i32(range.z) - 1);
    return mix(textureLoad(curve, vec2i(i, row), 0).rgb, textureLoad(curve, vec2i(i + 1, row), 0).rgb, x - f32(i));
}
//#endif

// The quantities of the side that the place lies on. `side.wgsl` has a function of each for the front and for the back.

fn reflectance_at(front: bool, place: Place) -> vec3f {
    if (front) {
        return front_reflectance(place);
    }
    return back_reflectance(place);
}

fn transmittance_at(front: bool, place: Place) -> vec3f {
    if (front) {
        return front_transmittance(place);
    }
    return back_transmittance(place);
}

//#if SUN
//#if !SKY
// ρt of a beam that enters a side, where it is needed. Colour maps already contain it.
fn needed_transmittance(front: bool, place: Place) -> vec3f {
    if (front) {
        //#if FRONT_COLOUR
        return vec3f(0.0);
        //#else
        return front_transmittance(place);
        //#endif
    }
    //#if BACK_COLOUR
    return vec3f(0.0);
    //#else
    return back_transmittance(place);
    //#endif
}
//#endif
//#endif

//#if SUN
// Whether any light of a beam that enters a side comes through. Colour maps say it themselves, whatever ρt is.
fn lets_through(front: bool, transmittance: vec3f) -> bool {
    let some = max(transmittance.r, max(transmittance.g, transmittance.b)) > 0.0;
    //#if FRONT_COLOUR
    if (front) {
        return true;
    }
    //#endif
    //#if BACK_COLOUR
    if (!front) {
        return true;
    }
    //#endif
    return some;
}
//#endif

//#if GLOSS
// ρs and m.
fn gloss_at(front: bool, place: Place) -> vec4f {
    if (front) {
        return front_gloss_at(place);
    }
    return back_gloss_at(place);
}
//#endif
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

// The mapped normal of a side, outward from that side.
fn mapped(front: bool, place: Place, axes: Basis) -> vec3f {
    if (front) {
        return front_mapped(place, axes);
    }
    return back_mapped(place, axes);
}
//#endif
