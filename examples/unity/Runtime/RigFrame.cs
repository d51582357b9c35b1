using UnityEngine;

namespace Tensionlab
{
    /// <summary>Places and directions of Unity's world as the rig has them, whose origin is at an object.</summary>
    public struct RigFrame
    {
        readonly Transform origin;
        readonly RigAxes axes;

        public RigFrame(Transform origin, RigAxes axes)
        {
            this.origin = origin;
            this.axes = axes;
        }

        public double[] Point(Vector3 point)
        {
            return axes.FromUnity(origin.InverseTransformPoint(point));
        }

        public double[] Direction(Vector3 direction)
        {
            return axes.FromUnity(origin.InverseTransformDirection(direction));
        }

        public double[] Lengths(Vector3 lengths)
        {
            return axes.Lengths(lengths);
        }

        public double[] Turn(Quaternion rotation)
        {
            return axes.FromUnity(Quaternion.Inverse(origin.rotation) * rotation);
        }
    }
}
