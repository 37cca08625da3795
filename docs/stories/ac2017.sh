# The commands of ac2017.md; run it in the folder of a checkout.
set -eu
fitmodels datasets/gc435_709m40/data.csv --out plan-fit
fitmodels limits plan-fit/GC435_709M40-En-19/params.json P=7kW Fxz=1500N AW=0.3mm V=50:200m/min f=0.06:0.6mm/rev n=50:2500rev/min
fitmodels replay plan-fit/GC435_709M40-En-19/params.json --system recursion
fitmodels limits plan-fit/GC435_709M40-En-19/params.json P=5.5kW V=60:150m/min f=0.1:0.4mm/rev --force
fitmodels replay plan-fit/GC435_709M40-En-19/params.json --system recursion --time 20min
fitmodels export plan-fit/GC435_709M40-En-19/params.json --to csv --time 20min --out plan.csv
fitmodels export plan-fit/GC435_709M40-En-19/params.json --to nc --time 11min --diameter 80mm --length 200mm --passes 2 --parts 3 --tool 1 --retract 200:150 --out plan.nc
fitmodels export plan-fit/GC435_709M40-En-19/params.json --to nc --time 11min --from 5.04min --pass 80:120,79:80:2 --parts 2 --dialect fanuc --speed G97 --retract 200:150 --out rest.nc
fitmodels card plan-fit/GC435_709M40-En-19/params.json --force
