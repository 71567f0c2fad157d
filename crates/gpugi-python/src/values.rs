//! Numbers and arrays from Python, checked: an exception names the argument.

use glam::{Mat4, Vec3};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyAny;

use crate::errors::wrong;

/// A finite number.
pub fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f32> {
    let number: f64 = value
        .extract()
        .map_err(|_| wrong(name, "a number is needed"))?;
    match (number as f32).is_finite() {
        true => Ok(number as f32),
        false => Err(wrong(name, format!("{number} is not finite"))),
    }
}

/// A number from `low` to `high`, both included.
pub fn number_in(name: &str, value: &Bound<'_, PyAny>, [low, high]: [f32; 2]) -> PyResult<f32> {
    let number = number(name, value)?;
    match (low..=high).contains(&number) {
        true => Ok(number),
        false => Err(wrong(
            name,
            format!("{number} does not lie between {low} and {high}"),
        )),
    }
}

/// As many finite numbers as there are.
pub fn numbers<const COUNT: usize>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f32; COUNT]> {
    let count = value.len().ok();
    if count != Some(COUNT) {
        return Err(wrong(name, format!("{COUNT} numbers are needed")));
    }
    let mut all = [0.0; COUNT];
    for (index, one) in all.iter_mut().enumerate() {
        *one = number(name, &value.get_item(index)?)?;
    }
    Ok(all)
}

/// A point or direction.
pub fn vector(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec3> {
    Ok(Vec3::from_array(numbers(name, value)?))
}

/// A colour or intensity: three numbers that are not negative, or one for all channels.
pub fn color(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec3> {
    let color = match value.extract::<f64>() {
        Ok(_) => Vec3::splat(number(name, value)?),
        Err(_) => vector(name, value)?,
    };
    match color.min_element() >= 0.0 {
        true => Ok(color),
        false => Err(wrong(name, format!("{} is below 0", color.min_element()))),
    }
}

/// A 4x4 matrix by rows, as NumPy writes it; its last row is 0, 0, 0, 1.
pub fn matrix(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Mat4> {
    let shape = || wrong(name, "a matrix of 4 rows with 4 numbers is needed");
    if value.len().ok() != Some(4) {
        return Err(shape());
    }
    let mut rows = [[0.0; 4]; 4];
    for (index, row) in rows.iter_mut().enumerate() {
        *row = numbers(name, &value.get_item(index)?).map_err(|error| {
            match value.get_item(index).and_then(|row| row.len()) {
                Ok(4) => error,
                _ => shape(),
            }
        })?;
    }
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(name, "its last row must be 0, 0, 0, 1"));
    }
    let matrix = Mat4::from_cols_array_2d(&rows).transpose();
    match matrix.inverse().is_finite() {
        true => Ok(matrix),
        false => Err(wrong(
            name,
            "its axes lie in a plane: nothing would be left of the object",
        )),
    }
}

/// A matrix as NumPy shows it: 4x4, by rows.
pub fn array_of<'py>(py: Python<'py>, matrix: &Mat4) -> PyResult<Bound<'py, PyAny>> {
    let rows = matrix.transpose().to_cols_array().to_vec();
    Ok(PyArray1::from_vec(py, rows).reshape([4, 4])?.into_any())
}

/// An image of so many channels per pixel, by rows from the top, without a copy: (height, width, channels), or (height,
/// width) of one.
pub fn image<'py, T: numpy::Element>(
    py: Python<'py>,
    [width, height]: [u32; 2],
    channels: usize,
    values: Vec<T>,
) -> PyResult<Bound<'py, PyAny>> {
    let [width, height] = [width as usize, height as usize];
    let flat = PyArray1::from_vec(py, values);
    Ok(match channels {
        1 => flat.reshape([height, width])?.into_any(),
        _ => flat.reshape([height, width, channels])?.into_any(),
    })
}

/// The rows of an array with `COLUMNS` numbers each, of whatever strides and number type.
pub fn rows<const COLUMNS: usize>(
    name: &str,
    value: &Bound<'_, PyAny>,
) -> PyResult<Vec<[f32; COLUMNS]>> {
    let array = as_array(name, value, "float32")?;
    let array = array
        .cast_into::<PyArray2<f32>>()
        .ok()
        .filter(|array| array.shape()[1] == COLUMNS)
        .ok_or_else(|| wrong(name, format!("an array of shape (N, {COLUMNS}) is needed")))?;
    let array = array.readonly();
    let values = array.as_slice().map_err(|error| wrong(name, error))?;
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        let place = index / COLUMNS;
        return Err(wrong(name, format!("row {place} holds {}", values[index])));
    }
    let (rows, _) = values.as_chunks::<COLUMNS>();
    Ok(rows.to_vec())
}

/// The rows of an array of whole numbers, three each.
pub fn triangles(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let numpy = value.py().import("numpy")?;
    let kind: String = numpy
        .call_method1("asarray", (value,))
        .and_then(|array| array.getattr("dtype")?.getattr("kind")?.extract())
        .map_err(|_| wrong(name, "an array is needed"))?;
    if kind != "i" && kind != "u" {
        return Err(wrong(name, "whole numbers are needed"));
    }
    let array = as_array(name, value, "int64")?;
    let array = array
        .cast_into::<PyArray2<i64>>()
        .ok()
        .filter(|array| array.shape()[1] == 3)
        .ok_or_else(|| wrong(name, "an array of shape (N, 3) is needed"))?;
    let array = array.readonly();
    let values = array.as_slice().map_err(|error| wrong(name, error))?;
    let whole = values.iter().map(|&value| {
        u32::try_from(value).map_err(|_| wrong(name, format!("{value} is no index of a vertex")))
    });
    let whole = whole.collect::<PyResult<Vec<u32>>>()?;
    Ok(whole.as_chunks::<3>().0.to_vec())
}

/// An image's size and numbers: (height, width, 3), of 32-bit floats.
pub fn pixels(name: &str, value: &Bound<'_, PyAny>) -> PyResult<([u32; 2], Vec<f32>)> {
    let array = as_array(name, value, "float32")?;
    let array = array
        .cast_into::<PyArray3<f32>>()
        .ok()
        .filter(|array| array.shape()[2] == 3)
        .ok_or_else(|| wrong(name, "an array of shape (height, width, 3) is needed"))?;
    let [height, width] = [array.shape()[0], array.shape()[1]];
    let sides = [u32::try_from(width), u32::try_from(height)];
    let [Ok(width @ 1..), Ok(height @ 1..)] = sides else {
        return Err(wrong(name, format!("{width}x{height} pixels are no image")));
    };
    Ok((
        [width, height],
        array.to_vec().map_err(|error| wrong(name, error))?,
    ))
}

/// `value` as a contiguous array of numbers of a type.
fn as_array<'py>(name: &str, value: &Bound<'py, PyAny>, of: &str) -> PyResult<Bound<'py, PyAny>> {
    let numpy = value.py().import("numpy")?;
    let given = numpy.call_method1("asarray", (value,));
    let kind = |array: &Bound<'_, PyAny>| array.getattr("dtype")?.getattr("kind")?.extract();
    let is_numbers = |array: &Bound<'_, PyAny>| {
        let kind: PyResult<String> = kind(array);
        kind.is_ok_and(|kind| ["f", "i", "u"].contains(&&*kind))
    };
    given
        .ok()
        .filter(is_numbers)
        .and_then(|array| numpy.call_method1("ascontiguousarray", (array, of)).ok())
        .ok_or_else(|| wrong(name, "an array of numbers is needed"))
}
