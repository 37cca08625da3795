# The commands of ac2016.md; run it in the folder of a checkout.
set -eu
fitmodels look datasets/gc435_709m40/data.csv
fitmodels datasets/gc435_709m40/data.csv --out region-fit
fitmodels limits region-fit/GC435_709M40-En-19/params.json P=7kW Fxz=1300N V=50:200m/min f=0.06:0.6mm/rev
fitmodels replay region-fit/GC435_709M40-En-19/params.json --system region --depth 2.5mm --time 10min
fitmodels replay region-fit/GC435_709M40-En-19/params.json --system region --depth 1.5mm --time 10min --out light-cut
fitmodels check region-fit/GC435_709M40-En-19/params.json
fitmodels export region-fit/GC435_709M40-En-19/params.json --system region --to c --out region.c
