// What a place of a leaf's maps says: reflectance, transmittance, mapped normal and gloss of a side, filtered over the
// pixel. Part of the main pass; the textures are declared in `side.wgsl`.

//#if LIT
// Where a fragment lies on both sides' maps, with screen derivatives for the choice of mip.
struct Place {
    front: vec2f,
    back: vec2f,
    dx: vec2f,
    dy: vec2f,
}

// The map's mean over the pixel: up to 16 trilinear samples along the longer axis of the pixel's footprint, each as
// wide as the shorter one, so that a blade seen at a slant is not blurred along its veins. Samplers' own anisotropic
// filters blur magnified maps too on some adapters (Mesa's software one); here a footprint of less than a texel is one
// plain bilinear sample everywhere.
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

//#if CURVE
// ρd (row 0) or ρt (row 1) of the slab at a thickness, linear between the curve's points.
fn slab(curve: texture_2d<f32>, range: vec4f, thickness: f32, row: i32) -> vec3f {
    let x = clamp((thickness - range.x) * range.y, 0.0, range.z);
    let i = min(i32(x), i32(range.z) - 1);
    return mix(textureLoad(curve, vec2i(i, row), 0).rgb, textureLoad(curve, vec2i(i + 1, row), 0).rgb, x - f32(i));
}
//#endif

// What a side says where the place lies on it: `side.wgsl` has a function of each kind for the front and for the back.

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
// ρt of a beam that enters a side, where it takes part: colour maps hold it already.
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

// A side's mapped normal, outward from that side.
fn mapped(front: bool, place: Place, axes: Basis) -> vec3f {
    if (front) {
        return front_mapped(place, axes);
    }
    return back_mapped(place, axes);
}
//#endif
