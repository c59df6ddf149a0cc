// Bark and ground: diffuse surfaces that transmit nothing. The inside is black.

struct Opaque {
    // The reflectance.
    albedo: vec4f,
    // Where the pattern begins in x and y of the world, and how often it is there in 1 mm.
    tile: vec4f,
}

@group(1) @binding(0) var<uniform> opaque: Opaque;
//#if PATTERN
@group(1) @binding(1) var tiles: sampler;
@group(1) @binding(5) var pattern: texture_2d<f32>;
//#endif

@fragment
fn fragment(in: Varying, @builtin(front_facing) front_facing: bool) -> @location(0) vec4f {
    var radiance = vec3f(0.0);
    //#if LIT
    var albedo = opaque.albedo;
    //#if PATTERN
    let place = (world_of(in).xy - opaque.tile.xy) * opaque.tile.zw;
    albedo = textureSample(pattern, tiles, vec2f(place.x, 1.0 - place.y));
    //#endif
    let across = cross(dpdx(world_of(in)), dpdy(world_of(in)));
    let facing = faced(in, front_facing, across);
    if (facing.front) {
        let normal = facing.towards_viewer;
        //#if TRANSFER
        radiance = albedo.rgb * max(vec3f(0.0), in.arrived) * 0.318309886;
        //#else
        //#if DOME
        radiance = albedo.rgb * even_light(normal);
        //#else
        //#if SKY
        radiance = frame.sky.rgb * albedo.rgb;
        //#endif
        //#endif
        //#endif
        //#if SUN
        let cosine = dot(normal, frame.sun_direction.xyz);
        if (cosine > 0.0) {
            radiance += sunlight(facing, world_of(in)) * cosine * albedo.rgb * 0.318309886;
        }
        //#endif
        //#if SCANNER
        radiance += under_tube(Scanned(normal, albedo.rgb), facing.view, world_of(in));
        //#endif
    }
    //#endif
    return held(radiance);
}
