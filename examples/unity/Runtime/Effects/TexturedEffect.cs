using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Rough surface: a wall along the object's y, friction on it, and ripples across its x.</summary>
    [AddComponentMenu("Tensionlab/Textured")]
    public class TexturedEffect : HapticEffect
    {
        [Min(0f), Tooltip("Stiffness K of the spring, in N/m.")]
        public float stiffness = 300f;
        [Min(0f), Tooltip("Damping B on the way in, in N s/m.")]
        public float damping = 2f;
        [Min(0f), Tooltip("Friction coefficient mu_s while it sticks.")]
        public float sticking = 0.5f;
        [Min(0f), Tooltip("Friction coefficient mu_d while it slides.")]
        public float sliding = 0.35f;
        [Min(0.0001f), Tooltip("Length l of one ripple, in m.")]
        public float period = 0.004f;
        [Min(0f), Tooltip("Height A of the ripples, in m.")]
        public float height = 0.0003f;

        protected override string Kind { get { return "textured"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["wall"] = new Dictionary<string, object>
            {
                { "plane", Plane(rig) }, { "stiffness", stiffness }, { "damping", damping }
            };
            parameters["friction"] = new Dictionary<string, object> { { "static", sticking }, { "dynamic", sliding } };
            parameters["ripples"] = new Dictionary<string, object>
            {
                { "direction", rig.Direction(transform.right) }, { "period", period }, { "height", height }
            };
        }
    }
}
