use calib_core::Seed; use calib_nn::*; use std::hint::black_box;
fn cpu()->f64{std::fs::read_to_string("/proc/thread-self/schedstat").unwrap().split(' ').next().unwrap().parse::<f64>().unwrap()/1e9}
fn time(name:&str, mac: f64, mut f: impl FnMut()) { f(); let mut best=f64::MAX; let mut all=vec![]; for _ in 0..9 { let t=cpu(); for _ in 0..60 { f(); } let s=(cpu()-t)/60.0; best=best.min(s); all.push(s);} all.sort_by(f64::total_cmp); println!("{name}: {:.3} ms best {:.3}  {:.0} GFLOP/s best {:.0}", all[4]*1e3, best*1e3, 2.0*mac/all[4]/1e9, 2.0*mac/best/1e9); }
fn main(){
 let mut net=Mlp::new(&[142,256,256,1],Seed::new(1)); let mut rng=Seed::new(2).rng();
 let input:Vec<f32>=(0..513*142).map(|_| rng.unit() as f32-0.5).collect(); let grad:Vec<f32>=(0..256).map(|_| rng.unit() as f32-0.5).collect();
 let mut w=Workspace::new(&net,513); let mut b=Bf16Workspace::new(&net,513,256); let mut batch=Bf16Batch::new(142,513,256); batch.set(&input,256);
 let mut r=Bf16Network::new(&net);
 let m=|a:usize,b:usize,c:usize| (a*b*c) as f64; let fwd=m(513,142,256)+m(513,256,256); let bwd=m(142,256,256)+2.0*m(256,256,256);
 let mut adam=Adam::new(AdamRule::default(), net.parameter_count()); let g:Vec<f32>=(0..net.parameter_count()).map(|_| rng.unit() as f32).collect();
 let rp=Bf16Network::portable(&net);
 let ww:Vec<f32>=(0..142*2304).map(|_| rng.unit() as f32-0.5).collect(); let mut out=vec![0.0f32;513*2304]; let left=Matrix::new(&input,513,142);
 let one=Mlp::new(&[142,256,1],Seed::new(1)); let wide=Mlp::new(&[142,2304,1],Seed::new(1)); let r9=vec![Bf16Network::new(&one);9]; let rw=Bf16Network::new(&wide);
 let mut b1=Bf16Workspace::new(&one,513,0); let mut bw=Bf16Workspace::new(&wide,513,0);
 for _ in 0..3 {
 time("bf16p forward",fwd,||{black_box(rp.forward(&batch,0..513,&mut b));});
 time("bf16p backward",bwd,||{black_box(rp.backward(&batch,&grad,&mut b));});
 let f1=9.0*m(513,142,256);
 time("f32 nine",f1,||{for (o,w) in out.chunks_exact_mut(513*256).zip(ww.chunks_exact(142*256)) {multiply(o,left,Matrix::new(w,142,256));}});
 time("f32 wide",f1,||{multiply(&mut out,left,Matrix::new(&ww,142,2304));});
 batch.set(&input,0);
 time("bf16 nine",f1,||{for n in &r9 {black_box(n.forward(&batch,0..513,&mut b1));}});
 time("bf16 wide",f1,||{black_box(rw.forward(&batch,0..513,&mut bw));});
 batch.set(&input,256);
 time("f32 forward",fwd,||{black_box(net.forward(&input,&mut w));});
 time("bf16 forward",fwd,||{black_box(r.forward(&batch,0..513,&mut b));});
 time("f32 backward",bwd,||{black_box(net.backward(&input,&grad,&mut w));});
 time("bf16 backward",bwd,||{black_box(r.backward(&batch,&grad,&mut b));});
 time("adam",0.0,||{adam.step(net.parameters_mut(),&g);});
 time("round",0.0,||{r.set(&net);});
 time("batch",0.0,||{batch.set(&input,256);});
 }
}
