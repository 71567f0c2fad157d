//! stub
use crate::gpu::*;
/// s
#[derive(Debug,Clone,Default)] pub struct DisplaySettings;
/// d
#[derive(Debug)] pub struct Display;
impl Display {
/// n
pub fn new(_:&Gpu,_:[u32;2])->Result<Self,GpuError>{Ok(Self)}
/// r
pub fn record(&self,_:&mut Frame,_:&wgpu::Buffer,_:u32,_:&DisplaySettings)->Result<(),GpuError>{Ok(())}
/// p
pub fn pixels(&self,_:&Gpu)->Result<Vec<u8>,GpuError>{Ok(vec![])}
}
