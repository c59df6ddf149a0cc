// What a place of the maps says: reflectance, transmittance, mapped normal and gloss of either side, filtered over the
// pixel. Part of the main pass; the textures are declared in `main.wgsl`.

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
        //#if FRONT_NORMAL
        let n = at(front_normal, place.front, place).xyz;
        return normalize(n.x * axes.tangent + n.y * axes.bitangent + n.z * axes.normal);
        //#else
        return axes.normal;
        //#endif
    }
    //#if BACK_NORMAL
    // The back's camera looks from behind: its right is against the tangent, its up along the bitangent, its z against
    // the normal.
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
