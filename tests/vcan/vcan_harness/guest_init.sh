# What the guest's first process does before and after the job. The host's files are its root, so whatever
# must not reach the host goes on a tmpfs. UML_MODULES, INSMOD and PYTHON are set by the caller.
set -u
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t tmpfs tmpfs /run
mkdir -p /dev/shm /run/tmp /run/home
mount -t tmpfs tmpfs /dev/shm
export TMPDIR=/run/tmp HOME=/run/home

modules=$UML_MODULES/$(uname -r)/kernel
for module in net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev \
              drivers/net/can/vcan drivers/net/can/vxcan net/sched/sch_tbf; do
    "$INSMOD" "$modules/$module.ko" || echo "guest: $module.ko cannot be loaded"
done
