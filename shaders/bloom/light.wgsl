// The light of an accumulated picture, of which some spreads: the composite pass's colours before they are cut to what a screen
// shows. What lies above its range has the range's last colour and is as many times brighter as it is larger, as the
// processor's `light`.
#import deepfield::bloom::{bloom, lit}
#import deepfield::colored::{composite, cells, last_cells, colored}
#import deepfield::srgb::decoded

fn light_of(sums: vec2<f32>) -> vec4<f32> {
    let color = colored(sums);
    var over = 1.0;
    if composite.high > 0.0 && sums.x > composite.high {
        over = min(sums.x / composite.high, bloom.most_light);
    }
    return vec4(over * color.a * decoded(color.rgb), color.a);
}

@compute @workgroup_size(#{GROUP}, #{GROUP})
fn light(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= bloom.fine) {
        return;
    }
    let cell = id.y * composite.stride + id.x;
    var seen = light_of(cells[cell]);
    if composite.share < 1.0 {
        seen = mix(light_of(last_cells[cell]), seen, composite.share);
    }
    lit[id.y * bloom.fine.x + id.x] = seen;
}
