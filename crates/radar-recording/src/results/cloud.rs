//! Coloured points as a Foxglove point cloud. The colour fields are those that both Foxglove and
//! Rerun read; `value` is the score, or the id of the obstacle or wall.

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{PackedElementField, PointCloud};
use glam::Vec3;

use super::super::foxglove_messages::{foxglove_pose, timestamp};
use radar_sar::geometry::Pose;

/// Bytes of a point: x, y, z, value as f32, then red, green, blue, alpha as bytes.
const STRIDE_BYTES: u32 = 20;

/// A coloured point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    pub position: Vec3,
    pub value: f32,
    pub rgba: [u8; 4],
}

/// The points as a message.
pub fn cloud(time_ns: i64, frame: &str, dots: &[Dot]) -> PointCloud {
    let field = |name: &str, offset: u32, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let numbers = (0..).zip(["x", "y", "z", "value"]).map(|(n, name)| field(name, 4 * n, NumericType::Float32));
    let colors = (16..).zip(["red", "green", "blue", "alpha"]).map(|(at, name)| field(name, at, NumericType::Uint8));
    let mut data = Vec::with_capacity(dots.len() * STRIDE_BYTES as usize);
    for dot in dots {
        let [x, y, z] = dot.position.to_array();
        data.extend([x, y, z, dot.value].into_iter().flat_map(f32::to_le_bytes));
        data.extend(dot.rgba);
    }
    PointCloud {
        timestamp: Some(timestamp(time_ns)),
        frame_id: frame.to_owned(),
        pose: Some(foxglove_pose(&Pose::IDENTITY)),
        point_stride: STRIDE_BYTES,
        fields: numbers.chain(colors).collect(),
        data: data.into(),
    }
}

/// Colour map from blue over orange to yellow for a share from 0 to 1; suitable for red-green
/// colour blindness.
pub fn heat(share: f32) -> [u8; 4] {
    const STOPS: [[f32; 3]; 4] =
        [[40.0, 60.0, 160.0], [150.0, 60.0, 150.0], [240.0, 120.0, 40.0], [255.0, 240.0, 120.0]];
    let along = if share.is_finite() { share.clamp(0.0, 1.0) * 3.0 } else { 0.0 };
    let n = (along as usize).min(2);
    let rest = along - n as f32;
    let mix = |c: usize| (STOPS[n][c] * (1.0 - rest) + STOPS[n + 1][c] * rest).round() as u8;
    [mix(0), mix(1), mix(2), 255]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_fields_match_their_offsets() {
        let dot = Dot { position: Vec3::new(1.0, -2.0, 0.5), value: 7.5, rgba: [1, 2, 3, 4] };
        let message = cloud(5, "sensor", &[dot, dot]);
        assert_eq!(message.data.len(), 2 * message.point_stride as usize);
        let second = &message.data[message.point_stride as usize..];
        let float = |n: usize| f32::from_le_bytes(second[message.fields[n].offset as usize..][..4].try_into().unwrap());
        assert_eq!([float(0), float(1), float(2), float(3)], [1.0, -2.0, 0.5, 7.5]);
        assert_eq!([4, 5, 6, 7].map(|n| second[message.fields[n].offset as usize]), [1, 2, 3, 4]);
    }

    #[test]
    fn heat_colours_get_brighter() {
        let brightness = |share| heat(share)[..3].iter().map(|c| u32::from(*c)).sum::<u32>();
        let all: Vec<u32> = (0..=10).map(|n| brightness(n as f32 / 10.0)).collect();
        assert!(all.windows(2).all(|pair| pair[0] <= pair[1]), "{all:?}");
        assert_eq!((heat(f32::NAN), heat(-1.0), heat(9.0)), (heat(0.0), heat(0.0), heat(1.0)));
    }
}
