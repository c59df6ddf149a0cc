//! The exported WGSL on a graphics adapter.

use super::cases::{ANSWERS, Case, DIRECTIONS, GIVEN};
use super::programs::{Form, without_values};
use crate::common::skips::{self, Need};
use mesophyll_viewer::{pollster, wgpu};
use wgpu::naga;
use wgpu::util::DeviceExt;

pub fn valid(text: &str) {
    let module = naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)));
    naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
        .validate(&module)
        .unwrap();
}

pub fn open() -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle().with_env());
    let Ok(adapter) = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())) else {
        skips::skip(Need::Adapter, "no graphics adapter (the text was parsed and validated only)");
        return None;
    };
    println!("adapter {}", adapter.get_info().name);
    if !adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS) {
        skips::skip(Need::Elsewhere, "the adapter computes nothing (the text was parsed and validated only)");
        return None;
    }
    pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).ok()
}

/// A compute shader around the text, one invocation a sky, and the polynomials' numbers, which come from a buffer, as
/// the text itself advises.
fn shader(form: Form, text: &str) -> (String, Vec<f32>) {
    let (text, values) = if form == Form::Fitted { without_values(text) } else { (text.to_string(), vec![0.0]) };
    let (buffer, make, first, only, list) = match form {
        // A binding that nothing reads would be no part of the layout.
        Form::Fixed => ("values", "place += i32(values[0]);", "", "", "SKY_HARMONICS"),
        Form::Fitted => (
            "SKY_VALUES",
            "let sky = sky_at(given[start], given[start + 1], given[start + 2], given[start + 3]);",
            "sky, ",
            "sky",
            "sky.harmonics",
        ),
    };
    let each = 3 * (49 + 2 + ANSWERS * DIRECTIONS);
    let harmonics: String = (0..49).map(|k| format!("    put({list}[{k}]);\n")).collect();
    let source = format!(
        "@group(0) @binding(0) var<storage, read> given: array<f32>;
@group(0) @binding(1) var<storage, read_write> found: array<f32>;
@group(0) @binding(2) var<storage, read> {buffer}: array<f32>;
{text}
var<private> place: i32;
fn put(v: vec3<f32>) {{
    found[place] = v.x;
    found[place + 1] = v.y;
    found[place + 2] = v.z;
    place += 3;
}}
@compute @workgroup_size(1) fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    let start = {GIVEN} * i32(id.x);
    place = {each} * i32(id.x);
    {make}
{harmonics}    put(sky_sun_direction({only}));
    put(sky_sun_light({only}));
    for (var k = 0; k < {DIRECTIONS}; k++) {{
        let at = start + 4 + 3 * k;
        let d = vec3<f32>(given[at], given[at + 1], given[at + 2]);
        put(sky_radiance({first}d));
        put(sky_irradiance({first}d));
        put(sky_drawn({first}d));
        put(sky_sun_disk({first}d));
    }}
}}"
    );
    (source, values)
}

pub fn run(device: &wgpu::Device, queue: &wgpu::Queue, form: Form, text: &str, cases: &[Case]) -> Vec<f64> {
    let (source, values) = shader(form, text);
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let held = |numbers: &[f32]| {
        let contents: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        let usage = wgpu::BufferUsages::STORAGE;
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents: &contents, usage })
    };
    let given: Vec<f32> = cases.iter().flat_map(|c| c.given.iter().copied()).collect();
    let (given, values) = (held(&given), held(&values));
    let size = (cases.len() * 3 * (49 + 2 + ANSWERS * DIRECTIONS) * 4) as u64;
    let buffer =
        |usage| device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let found = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let back = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let bind = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: given.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: found.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 2, resource: values.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind, &[]);
        pass.dispatch_workgroups(cases.len() as u32, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&found, 0, &back, 0, size);
    queue.submit([encoder.finish()]);
    back.map_async(wgpu::MapMode::Read, .., |r| r.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let view = back.get_mapped_range(..).unwrap();
    view.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect()
}
