//! Mutations of JSON documents.

use serde_json::{Value, json};

use crate::random::Random;

pub fn mutate_text(random: &mut Random, bytes: &mut Vec<u8>) {
    match serde_json::from_slice::<Value>(bytes) {
        Ok(mut value) => {
            mutate(random, &mut value);
            *bytes = value.to_string().into_bytes();
        }
        Err(_) => super::text::mutate(random, bytes),
    }
}

pub fn mutate(random: &mut Random, root: &mut Value) {
    let mut count = 0;
    visit(root, &mut |_| count += 1);
    let donor = nth(root, random.below(count)).clone();
    let target = nth(root, random.below(count));
    match random.below(10) {
        // Mostly leaves, because they are the most.
        0..=3 => replace(random, target),
        4 => *target = donor,
        5 | 6 => repeat_or_remove(random, target),
        7 => swap(random, target),
        8 => {
            if let Value::Object(members) = target {
                let (name, value) = random.pick(&extras()).clone();
                members.insert(name, value);
            }
        }
        _ => *target = random.pick(&odd()).clone(),
    }
}

fn replace(random: &mut Random, target: &mut Value) {
    match target {
        Value::Number(number) if random.once_in(2) => {
            let number = number.as_f64().unwrap_or(0.0);
            let change = *random.pick(&[1.0, -1.0, 0.5, 1000.0]);
            *target = json!(number + change);
            if random.once_in(2) {
                *target = json!((number + change).abs() as u64);
            }
        }
        Value::Number(_) => {
            let numbers = [
                json!(0),
                json!(1),
                json!(-1),
                json!(3),
                json!(255),
                json!(65_535),
                json!(4_294_967_295_u64),
                json!(u64::MAX),
                json!(1e38),
                json!(-1e38),
                json!(1e-45),
                json!(0.5),
                json!(100_000),
                json!(5121),
                json!(5123),
                json!(5125),
                json!(5126),
            ];
            *target = random.pick(&numbers).clone();
        }
        Value::String(text) => {
            let words = [
                "SCALAR",
                "VEC2",
                "VEC3",
                "VEC4",
                "MAT4",
                "STEP",
                "CUBICSPLINE",
                "weights",
                "rotation",
                "MASK",
                "BLEND",
                "spot",
                "directional",
                "../../etc/passwd",
                "data:,",
                "data:;base64,AAAA",
                "",
                "ATTRIBUTES",
                "INDICES",
            ];
            *text = (*random.pick(&words)).to_owned();
        }
        Value::Bool(value) => *value = !*value,
        Value::Null => *target = json!(0),
        Value::Array(_) | Value::Object(_) => repeat_or_remove(random, target),
    }
}

fn repeat_or_remove(random: &mut Random, target: &mut Value) {
    match target {
        Value::Array(list) if !list.is_empty() => {
            let at = random.below(list.len());
            if random.once_in(2) {
                list.remove(at);
            } else {
                let times = 1 << random.below(if list.len() > 256 { 1 } else { 8 });
                let item = list[at].clone();
                list.extend(std::iter::repeat_n(item, times));
            }
        }
        Value::Object(members) if !members.is_empty() => {
            let at = random.below(members.len());
            if let Some(name) = members.keys().nth(at).cloned() {
                members.shift_remove(&name);
            }
        }
        _ => {}
    }
}

fn swap(random: &mut Random, target: &mut Value) {
    match target {
        Value::Array(list) if list.len() > 1 => {
            let (a, b) = (random.below(list.len()), random.below(list.len()));
            list.swap(a, b);
        }
        Value::Object(members) if members.len() > 1 => {
            let (a, b) = (random.below(members.len()), random.below(members.len()));
            let value = members.values().nth(a).cloned().unwrap_or_default();
            if let Some(other) = members.values_mut().nth(b) {
                *other = value;
            }
        }
        _ => {}
    }
}

fn extras() -> Vec<(String, Value)> {
    [
        ("extras", json!({ "gpugi": { "phong": { "kd": [0.9, 0, 0], "ks": [0, 0.9, 0], "shininess": 1e9 } } })),
        ("extras", json!({ "gpugi": { "conductor": { "n": [0.1, 1e20, 1], "k": [0, 0, 1e20] } } })),
        ("extras", json!({ "gpugi": { "radius": 1e30 } })),
        ("mode", json!(5)),
        ("mode", json!(6)),
        ("indices", json!(0)),
        ("skin", json!(0)),
        ("normalized", json!(true)),
        ("byteStride", json!(0)),
        ("alphaMode", json!("BLEND")),
        ("scene", json!(0)),
        ("children", json!([0, 1])),
        ("weights", json!([1, 1])),
        ("matrix", json!([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1])),
        ("normalTexture", json!({ "index": 0, "texCoord": 1 })),
        (
            "sparse",
            json!({
                "count": 1,
                "indices": { "bufferView": 0, "componentType": 5121 },
                "values": { "bufferView": 0 },
            }),
        ),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .to_vec()
}

fn odd() -> Vec<Value> {
    vec![
        json!(null),
        json!([]),
        json!({}),
        json!(""),
        json!(0),
        json!([[]]),
        json!(true),
    ]
}

fn visit(value: &Value, on: &mut impl FnMut(&Value)) {
    on(value);
    match value {
        Value::Array(list) => list.iter().for_each(|element| visit(element, on)),
        Value::Object(members) => members.values().for_each(|member| visit(member, on)),
        _ => {}
    }
}

/// The value that a depth-first walk reaches after `n` others.
fn nth(root: &mut Value, n: usize) -> &mut Value {
    fn size(value: &Value) -> usize {
        let mut count = 0;
        visit(value, &mut |_| count += 1);
        count
    }
    let mut value = root;
    let mut left = n;
    loop {
        if left == 0 {
            return value;
        }
        left -= 1;
        let children: Vec<&mut Value> = match value {
            Value::Array(list) => list.iter_mut().collect(),
            Value::Object(members) => members.values_mut().collect(),
            _ => unreachable!("n is less than the number of values"),
        };
        let mut found = None;
        for child in children {
            let count = size(child);
            if left < count {
                found = Some(child);
                break;
            }
            left -= count;
        }
        value = found.expect("n is less than the number of values");
    }
}
